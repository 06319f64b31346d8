"""Spoilt masks: other than the truth, near it, as many kinds as named, and reproducible."""

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.outline.coarse import outline_of, spoil_mask

SIDE = 96


def disc() -> NDArray[np.uint8]:
    mask = np.zeros((SIDE, SIDE), np.uint8)
    cv2.circle(mask, (SIDE // 2, SIDE // 2), 28, 255, -1)
    return mask


def spoilt(count: int) -> NDArray[np.float32]:
    return np.stack([spoil_mask(np.random.default_rng(k), disc()) for k in range(count)])


def test_maps_are_shares_and_follow_from_the_seed() -> None:
    maps = spoilt(20)
    assert maps.dtype == np.float32
    assert maps.min() >= 0
    assert maps.max() <= 1
    assert np.array_equal(maps, spoilt(20))


def test_outlines_err_and_the_object_stays_where_it_is() -> None:
    maps, truth = spoilt(40), disc() > 127
    wrong = np.array([((map_ > 0.5) != truth).sum() for map_ in maps])
    assert (wrong > 0).all()
    assert np.median(wrong) < 0.35 * truth.sum()
    mean = maps.mean(axis=0)
    assert mean[truth].mean() > 0.8
    assert mean[~truth].mean() < 0.15


def test_some_are_thresholded_and_some_are_not() -> None:
    hard = [set(np.unique(map_)) <= {0.0, 1.0} for map_ in spoilt(40)]
    assert 5 < sum(hard) < 30


def test_what_has_no_outline_stays_without_an_object() -> None:
    empty = np.zeros((SIDE, SIDE), np.uint8)
    maps = [spoil_mask(np.random.default_rng(k), empty) for k in range(10)]
    assert max(float((map_ > 0.5).mean()) for map_ in maps) < 0.02


def test_the_outline_is_next_to_where_the_mask_ends() -> None:
    mask = np.zeros((8, 8), np.uint8)
    mask[:, 4:] = 1
    assert set(outline_of(mask)[:, 0]) == {3, 4}
    assert len(outline_of(np.zeros((8, 8), np.uint8))) == 0
