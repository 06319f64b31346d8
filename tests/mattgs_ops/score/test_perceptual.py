"""FLIP: its range, its direction, what it sees and what it does not."""

import numpy as np
import pytest

from mattgs_ops.errors import InputError
from mattgs_ops.score.perceptual import flip_map

SHAPE = (40, 52, 3)
TRUTH = np.random.default_rng(4).random(SHAPE)


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
