"""Image metrics against plain reimplementations, and what the in-mask versions are for."""

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from mattgs_ops.errors import InputError
from mattgs_ops.score import metric_table, metrics
from mattgs_ops.score.metric_table import METRICS
from mattgs_ops.score.perceptual import flip_map

RNG = np.random.default_rng(11)
TRUTH = RNG.random((24, 30, 3))
IMAGE = np.clip(TRUTH + 0.1 * RNG.normal(size=TRUTH.shape), 0, 1)


def scored(*pictures: np.ndarray) -> dict[str, float]:
    """Return the scores of an image, its truth, mask and ids that have a value."""
    image, truth, mask, ids = pictures
    scores = metrics.score_view(image, truth, mask, attention=ids, ssim_lambda=0.2)
    return {name: value for name, value in scores.items() if value is not None}


def disc(radius: float, height: int = 40, width: int = 48) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return (x - width / 2) ** 2 + (y - height / 2) ** 2 < radius**2


def slow_ssim(image: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Wang et al. 2004, eq. 13, one window at a time; [H - 10, W - 10], the mean over channels."""
    offsets = np.arange(-5, 6)
    weights = np.exp(-(offsets**2) / (2 * 1.5**2))
    window = np.outer(weights, weights) / weights.sum() ** 2
    height, width, channels = truth.shape
    out = np.zeros((height - 10, width - 10))
    for y in range(height - 10):
        for x in range(width - 10):
            for c in range(channels):
                a, b = image[y : y + 11, x : x + 11, c], truth[y : y + 11, x : x + 11, c]
                ma, mb = (window * a).sum(), (window * b).sum()
                va, vb = (window * a * a).sum() - ma**2, (window * b * b).sum() - mb**2
                cov = (window * a * b).sum() - ma * mb
                top = (2 * ma * mb + 0.01**2) * (2 * cov + 0.03**2)
                out[y, x] += top / ((ma**2 + mb**2 + 0.01**2) * (va + vb + 0.03**2)) / channels
    return out


def test_ssim_is_the_gaussian_form() -> None:
    expected = slow_ssim(IMAGE, TRUTH)
    assert metrics.ssim(IMAGE, TRUTH) == pytest.approx(expected.mean(), abs=1e-9)
    np.testing.assert_allclose(metrics.ssim_map(IMAGE, TRUTH)[5:-5, 5:-5], expected, atol=1e-9)


def test_ssim_equals_scikit_image() -> None:
    """At the frame's border too: masks reach it."""
    expected, full = structural_similarity(
        IMAGE,
        TRUTH,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1,
        channel_axis=-1,
        full=True,
    )
    assert metrics.ssim(IMAGE, TRUTH) == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(metrics.ssim_map(IMAGE, TRUTH), full.mean(axis=2), atol=1e-12)


def test_small_structures_are_scored_on_their_own_pixels_inside_the_mask() -> None:
    details, mask = np.zeros((24, 30), bool), np.ones((24, 30), bool)
    details[8:12, 10:20] = True
    mask[:, 15:] = False
    attention = np.zeros(details.shape)
    scores = metrics.score_view(
        IMAGE, TRUTH, mask, attention=attention, ssim_lambda=0.2, details=details
    )
    small = np.s_[8:12, 10:15]
    error = np.mean((IMAGE[small] - TRUTH[small]) ** 2)
    assert scores["detail_psnr"] == pytest.approx(-10 * np.log10(error))
    assert scores["detail_ssim"] == pytest.approx(metrics.ssim_map(IMAGE, TRUTH)[small].mean())
    assert scores["detail_flip"] == pytest.approx(flip_map(IMAGE, TRUTH)[small].mean())
    nobody_knows = metrics.score_view(IMAGE, TRUTH, mask, attention=attention, ssim_lambda=0.2)
    assert nobody_knows["detail_psnr"] is None
    assert nobody_knows["detail_ssim"] is None
    assert nobody_knows["detail_flip"] is None


def test_psnr_and_l1_are_what_their_names_say() -> None:
    image = np.full((12, 12, 3), 0.5)
    truth = image.copy()
    truth[:6] = 0.6
    assert metrics.l1(image, truth) == pytest.approx(0.05)
    assert metrics.psnr(image, truth) == pytest.approx(-10 * np.log10(0.005))


def test_identical_images_reach_the_ceiling_and_stay_finite() -> None:
    assert metrics.psnr(TRUTH, TRUTH) == metrics.PSNR_CEILING == 100
    assert metrics.ssim(TRUTH, TRUTH) == pytest.approx(1)
    assert metrics.l1(TRUTH, TRUTH) == 0


def test_one_grey_level_in_one_pixel_is_below_the_ceiling() -> None:
    image = np.zeros((64, 64, 3))
    changed = image.copy()
    changed[0, 0, 0] = 1 / 255
    expected = 10 * np.log10(255**2 * image.size)
    assert metrics.psnr(changed, image) == pytest.approx(expected)
    assert expected < metrics.PSNR_CEILING


def test_eq_15_is_the_mean_of_weight_times_difference() -> None:
    weights = RNG.random((24, 30))
    total = sum(
        weights[y, x] * abs(IMAGE[y, x, c] - TRUTH[y, x, c])
        for y in range(24)
        for x in range(30)
        for c in range(3)
    )
    assert metrics.weighted_l1(IMAGE, TRUTH, weights) == pytest.approx(total / (24 * 30 * 3))


# ------------------------------------------------------------------------------- in the mask


def noisy_object(mask: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth = rng.random((*mask.shape, 3))
    return np.clip(truth + 0.1 * rng.normal(size=truth.shape), 0, 1), truth


def test_a_removed_background_does_not_change_scores_in_the_mask() -> None:
    """Full-frame PSNR rises by −10 log10 of the object's share; in the mask nothing changes."""
    mask = disc(14)
    image, truth = noisy_object(mask)
    outside = ~mask
    white_image, white_truth = image.copy(), truth.copy()
    white_image[outside], white_truth[outside] = 1, 1
    nothing = np.zeros(mask.shape)
    kept = scored(image, truth, mask, nothing)
    removed = scored(white_image, white_truth, mask, nothing)
    for part in metric_table.PARTS:
        for name in ("psnr", "l1"):
            assert removed[f"{part}_{name}"] == pytest.approx(kept[f"{part}_{name}"])
    assert removed["core_ssim"] == pytest.approx(kept["core_ssim"])
    # windows of the rim see what stands beside it
    assert abs(removed["rim_ssim"] - kept["rim_ssim"]) > 0.01
    in_mask = metrics.mask_psnr(image, truth, mask)
    assert in_mask is not None
    gain = metrics.psnr(white_image, white_truth) - in_mask
    assert gain == pytest.approx(-10 * np.log10(mask.mean()), abs=1e-6)


def test_means_are_over_the_masks_pixels() -> None:
    image, truth = np.zeros((20, 20, 3)), np.zeros((20, 20, 3))
    mask = np.zeros((20, 20), bool)
    mask[4:6, 4:6] = True
    truth[4, 4], truth[0, 0] = 0.4, 1.0  # the second lies outside
    assert metrics.mask_l1(image, truth, mask) == pytest.approx(0.1)
    assert metrics.mask_psnr(image, truth, mask) == pytest.approx(-10 * np.log10(0.16 / 4))


def test_a_mask_of_the_whole_frame_gives_the_full_frames_scores() -> None:
    mask = np.ones(TRUTH.shape[:2], bool)
    assert metrics.mask_psnr(IMAGE, TRUTH, mask) == pytest.approx(metrics.psnr(IMAGE, TRUTH))
    assert metrics.mask_l1(IMAGE, TRUTH, mask) == pytest.approx(metrics.l1(IMAGE, TRUTH))
    scores = metrics.score_view(IMAGE, TRUTH, mask, attention=np.zeros(mask.shape), ssim_lambda=0.2)
    assert scores["core_ssim"] == pytest.approx(metrics.ssim(IMAGE, TRUTH))


def test_the_core_is_five_pixels_inside() -> None:
    mask = np.zeros((40, 40), bool)
    mask[10:31, :] = True
    core = metrics.mask_core(mask)
    assert np.argwhere(core.any(axis=1)).ravel().tolist() == list(range(15, 26))
    assert np.argwhere(core.any(axis=0)).ravel().tolist() == list(range(5, 35))


def test_what_does_not_exist_is_none() -> None:
    empty, thin = np.zeros((24, 30), bool), np.zeros((24, 30), bool)
    thin[:, 10:14] = True
    assert metrics.mask_psnr(IMAGE, TRUTH, empty) is None
    assert metrics.mask_l1(IMAGE, TRUTH, empty) is None
    scores = metrics.score_view(IMAGE, TRUTH, thin, attention=np.zeros(thin.shape), ssim_lambda=0.2)
    assert scores["core_psnr"] is scores["core_ssim"] is scores["core_l1"] is None
    for name in ("psnr", "ssim", "l1"):  # all rim
        assert scores[f"rim_{name}"] == scores[f"mask_{name}"] is not None


def test_an_error_is_scored_in_the_part_where_it_is() -> None:
    mask = disc(14)
    parts = metrics.object_parts(mask)
    assert (parts["core"] | parts["rim"] == mask).all()
    assert not (parts["core"] & parts["rim"]).any()
    truth, nothing = noisy_object(mask)[1], np.zeros(mask.shape)
    for spoilt, kept in (("core", "rim"), ("rim", "core")):
        image = truth.copy()
        image[parts[spoilt]] = 1 - image[parts[spoilt]]
        scores = scored(image, truth, mask, nothing)
        assert scores[f"{kept}_psnr"] == metrics.PSNR_CEILING
        assert scores[f"{spoilt}_psnr"] < scores["mask_psnr"] < 20
        assert scores[f"{spoilt}_ssim"] < scores[f"{kept}_ssim"]


def test_the_whole_objects_error_is_the_mean_of_its_parts() -> None:
    mask = disc(14)
    image, truth = noisy_object(mask)
    scores = metrics.score_view(image, truth, mask, attention=np.zeros(mask.shape), ssim_lambda=0.2)
    sizes = {name: pixels.sum() for name, pixels in metrics.object_parts(mask).items()}
    for name in ("ssim", "l1"):
        total = sum(sizes[part] * scores[f"{part}_{name}"] for part in ("core", "rim"))
        assert total / sizes["mask"] == pytest.approx(scores[f"mask_{name}"])


# ------------------------------------------------------------------------------- all at once


def test_a_views_scores_agree_with_each_metric_by_itself() -> None:
    mask, attention = disc(11, 24, 30), RNG.random((24, 30))
    scores = metrics.score_view(IMAGE, TRUTH, mask, attention=attention, ssim_lambda=0.2)
    assert set(scores) == set(metric_table.IMAGE_METRICS)
    assert scores["ssim"] == pytest.approx(metrics.ssim(IMAGE, TRUTH))
    assert scores["mask_ssim"] == pytest.approx(metrics.ssim_map(IMAGE, TRUTH)[mask].mean())
    core = metrics.mask_core(mask)
    assert scores["core_ssim"] == pytest.approx(metrics.ssim_map(IMAGE, TRUTH)[core].mean())
    assert scores["loss"] == pytest.approx(
        0.8 * metrics.l1(IMAGE, TRUTH) + 0.2 * (1 - metrics.ssim(IMAGE, TRUTH))
    )
    weighted = metrics.weighted_l1(IMAGE, TRUTH, attention)
    assert scores["paper_l1"] == pytest.approx(weighted)
    assert scores["paper_loss"] == pytest.approx(
        0.8 * weighted + 0.2 * (1 - metrics.ssim(IMAGE, TRUTH))
    )


def test_views_without_a_mask_have_no_scores_in_it() -> None:
    scores = metrics.score_view(IMAGE, TRUTH, None, attention=np.ones((24, 30)), ssim_lambda=0.2)
    assert scores["mask_psnr"] is scores["mask_ssim"] is scores["mask_l1"] is None
    assert scores["paper_l1"] == pytest.approx(scores["l1"])


@pytest.mark.parametrize("shape", [(24, 31, 3), (24, 30), (24, 30, 1)])
def test_images_of_different_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="two images of one size"):
        metrics.l1(np.zeros(shape), TRUTH)


def test_images_smaller_than_the_window_are_refused() -> None:
    with pytest.raises(InputError, match="11 x 11 pixels at least, found 30 x 10"):
        metrics.ssim(IMAGE[:10], TRUTH[:10])


def test_the_table_is_whole() -> None:
    assert all(name == metric.id for name, metric in METRICS.items())
    images, held_out = metric_table.IMAGE_METRICS, metric_table.HELD_OUT_ONLY
    known_in_training = [name for name in images if name not in held_out]
    assert {*images, *(f"train_{n}" for n in known_in_training)} <= set(METRICS)
    for metric in METRICS.values():
        assert metric.direction in (-1, 0, 1)
        assert metric.label
        assert metric.description
        assert metric.version >= 1
    assert METRICS["train_psnr"].direction == METRICS["psnr"].direction == 1
    assert "training views" in METRICS["train_l1"].description
