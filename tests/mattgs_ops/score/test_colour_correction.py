"""Colour correction finds an affine change of colour, and nothing else."""

import numpy as np
import pytest

from mattgs_ops.score.colour_correction import colour_corrected
from mattgs_ops.score.metrics import mask_psnr, psnr, score_view

RNG = np.random.default_rng(4)
TRUTH = 0.2 + 0.6 * RNG.random((24, 30, 3))


def test_another_exposure_is_undone() -> None:
    matrix = np.array([[0.7, 0.05, 0.0], [0.02, 0.8, 0.03], [0.0, 0.1, 0.6]])
    rendered = TRUTH @ matrix.T + 0.03
    assert psnr(rendered, TRUTH) < 20
    np.testing.assert_allclose(colour_corrected(rendered, TRUTH), TRUTH, atol=1e-9)


def test_structure_is_not_repaired() -> None:
    mirrored = TRUTH[:, ::-1]
    assert psnr(colour_corrected(mirrored, TRUTH), TRUTH) == pytest.approx(
        psnr(np.broadcast_to(TRUTH.mean(axis=(0, 1)), TRUTH.shape), TRUTH), abs=0.2
    )


def test_only_the_masks_pixels_are_fitted() -> None:
    mask = np.zeros(TRUTH.shape[:2], dtype=bool)
    mask[5:15, 5:20] = True
    rendered = np.where(mask[..., None], 0.5 * TRUTH, RNG.random(TRUTH.shape))
    fitted = colour_corrected(rendered, TRUTH, mask)
    np.testing.assert_allclose(fitted[mask], TRUTH[mask], atol=1e-9)


def test_corrected_colours_stay_in_range() -> None:
    rendered = 0.3 + 0.4 * TRUTH
    rendered[0, 0], rendered[0, 1] = 1.0, 0.0  # beyond all that the fit is made by
    fitted = colour_corrected(rendered, TRUTH)
    assert (fitted[0, 0] == 1).all()
    assert (fitted[0, 1] == 0).all()
    assert (fitted.min(), fitted.max()) == (0, 1)


def test_one_colour_everywhere_is_no_trouble() -> None:
    flat = np.full_like(TRUTH, 0.3)
    fitted = colour_corrected(flat, TRUTH)
    np.testing.assert_allclose(fitted, np.broadcast_to(TRUTH.mean(axis=(0, 1)), TRUTH.shape))


def test_scores_stand_beside_the_plain_ones() -> None:
    mask = np.zeros(TRUTH.shape[:2], dtype=bool)
    mask[4:20, 4:26] = True
    rendered = np.clip(0.8 * TRUTH + 0.02 * RNG.normal(size=TRUTH.shape), 0, 1)
    scores = score_view(rendered, TRUTH, mask, attention=np.ones(mask.shape), ssim_lambda=0.2)
    assert scores["cc_psnr"] == pytest.approx(psnr(colour_corrected(rendered, TRUTH), TRUTH))
    inside = mask_psnr(colour_corrected(rendered, TRUTH, mask), TRUTH, mask)
    assert scores["mask_cc_psnr"] == pytest.approx(inside)
    assert scores["cc_psnr"] > scores["psnr"] + 3  # type: ignore[operator]
    assert (
        score_view(rendered, TRUTH, None, attention=np.ones(mask.shape), ssim_lambda=0.2)[
            "mask_cc_psnr"
        ]
        is None
    )
