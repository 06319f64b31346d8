"""FLIP: its range, its direction, what it sees and what it does not."""

import cv2
import flip_evaluator
import numpy as np
import pytest

from mattgs_ops.errors import InputError
from mattgs_ops.score.perceptual import flip_map

SHAPE = (40, 52, 3)
TRUTH = np.random.default_rng(4).random(SHAPE)


def by_the_library(image: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return what the authors' own library says, at its defaults."""
    errors, _, _ = flip_evaluator.evaluate(
        truth.astype(np.float32), image.astype(np.float32), "LDR", True, False, False, {}
    )
    return np.asarray(errors, dtype=np.float64)[..., 0]


@pytest.mark.parametrize("kind", ["noise", "smooth", "faint", "colours"])
def test_it_is_the_flip_of_its_authors(kind: str) -> None:
    """Colour errors are raised to 0.7, which enlarges rounding where images are nearly the same."""
    rng = np.random.default_rng(9)
    truth, image = rng.random((2, 61, 47, 3))
    if kind != "noise":
        truth, image = (cv2.GaussianBlur(one, (0, 0), 4) for one in (truth, image))
    if kind == "faint":
        image = np.clip(truth + np.rint(rng.normal(size=truth.shape)) / 255, 0, 1)
    if kind == "colours":
        truth[:30], image[:30] = (0, 1, 0), (0, 0, 1)  # as far apart as can be
        truth[30:], image[30:] = (0.01, 0.03, 0.02), (0.02, 0.02, 0.03)  # sRGB's linear part
    expected, found = by_the_library(image, truth), flip_map(image, truth)
    np.testing.assert_allclose(found, expected, atol=3e-4)
    assert found.mean() == pytest.approx(expected.mean(), abs=1e-6)
    assert expected.mean() > 0.01


def test_where_images_lie_in_memory_changes_nothing() -> None:
    rng = np.random.default_rng(5)
    truth, image = np.rint(rng.random((2, 36, 48, 3)) * 255) / 255
    expected = flip_map(image, truth)
    kept: list[np.ndarray] = []  # moves what is allocated next
    for size in rng.integers(1, 3000, 200):
        kept = [*kept[-20:], np.empty(size, np.uint8)]
        np.testing.assert_array_equal(flip_map(image, truth), expected)


def test_the_same_image_looks_the_same_and_black_and_white_do_not() -> None:
    assert flip_map(TRUTH, TRUTH).max() == 0
    black, white = np.zeros(SHAPE), np.ones(SHAPE)
    errors = flip_map(white, black)
    assert errors.shape == SHAPE[:2]
    assert 0.9 < errors.min() <= errors.max() <= 1


def test_a_larger_difference_looks_larger_and_where_it_is() -> None:
    grey = np.full(SHAPE, 0.5)
    means = []
    for step in (0.02, 0.1, 0.3):
        image = grey.copy()
        image[:, :10] += step
        errors = flip_map(image, grey)
        means.append(errors[:, :10].mean())
        assert errors[:, :5].mean() > errors[:, 40:].mean()
    assert 0 < means[0] < means[1] < means[2]


def test_what_the_eye_does_not_resolve_counts_less() -> None:
    """Errors of one mean square: as a chequerboard of pixels they look smaller than as a step."""
    grey = np.full(SHAPE, 0.5)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    fine, coarse = grey.copy(), grey.copy()
    fine += np.where((x + y) % 2 == 0, 0.1, -0.1)[..., None]
    coarse += np.where(x < SHAPE[1] // 2, 0.1, -0.1)[..., None]
    assert np.mean((fine - grey) ** 2) == pytest.approx(np.mean((coarse - grey) ** 2))
    assert flip_map(fine, grey).mean() < 0.7 * flip_map(coarse, grey).mean()


def test_images_of_different_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="two images of one size"):
        flip_map(TRUTH[:-1], TRUTH)
