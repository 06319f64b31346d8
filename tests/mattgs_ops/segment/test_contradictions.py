"""Masks contradict each other where points that two photos share lie in one of them alone."""

import numpy as np
import pytest

from mattgs_ops.segment.contradictions import FEWEST_POINTS, Contradictions, contradictions
from mattgs_ops.segment.quick_matches import SIDE, Matches, Pair

POINTS = 40
PLACES = np.stack([np.full(POINTS, 10), np.arange(POINTS)], axis=1).astype(np.float32)


def matched(count: int = POINTS) -> Matches:
    """Return a pair whose points keep their places: a column of them, from the top."""
    return Matches(0.0, 0.0, 0, np.stack([PLACES[:count], PLACES[:count]], axis=1))


def mask(first: int, last: int, scale: int = 1) -> np.ndarray:
    """Return a mask that holds the points ``first`` to ``last`` of a column."""
    pixels = np.zeros((60 * scale, 80 * scale), np.uint8)
    pixels[first * scale : last * scale] = 255
    return pixels


def of(masks: list[np.ndarray], pairs: list[Pair], count: int = POINTS) -> Contradictions:
    return contradictions({pair: matched(count) for pair in pairs}, masks)


def test_points_outside_both_masks_say_nothing() -> None:
    found = of([mask(0, 32), mask(0, 32)], [(0, 1)])
    assert found == Contradictions(1.0, ())


def test_the_share_is_of_points_in_either_mask() -> None:
    found = of([mask(0, 30), mask(10, 40)], [(0, 1)])
    assert found == Contradictions(0.5, ())  # 20 in both, 20 in one alone: no contradiction yet


def test_more_points_in_one_mask_alone_than_in_both_contradict() -> None:
    found = of([mask(0, 30), mask(11, 40)], [(0, 1)])
    assert found.shared == pytest.approx(19 / 40)
    assert found.views == (
        0,
    )  # either may be wrong; without its points nothing speaks against the other


def test_few_points_say_nothing_of_a_mask() -> None:
    masks = [mask(0, 40), mask(0, 0)]
    assert of(masks, [(0, 1)], FEWEST_POINTS).shared == 0.0
    assert of(masks, [(0, 1)], FEWEST_POINTS - 1) == Contradictions(1.0, ())


def test_one_wrong_mask_is_named_and_not_those_that_it_contradicts() -> None:
    """Photo 1 has another part than the four others, of which each is matched with it and one."""
    masks = [mask(0, 20)] * 5
    masks[1] = mask(20, 40)
    found = of(masks, [(0, 1), (1, 2), (1, 3), (1, 4), (0, 2), (3, 4)])
    assert found.views == (1,)
    assert found.shared == pytest.approx(40 / (4 * 40 + 40))


def test_a_points_place_is_read_in_its_own_photo() -> None:
    """The second photo is shifted by 15 points, and so is its mask."""
    places = np.stack([PLACES, PLACES + np.float32([0, 15])], axis=1)
    shifted = {(0, 1): Matches(15.0, 0.0, POINTS, places)}
    assert contradictions(shifted, [mask(0, 30), mask(15, 45)]) == Contradictions(1.0, ())
    assert contradictions(shifted, [mask(15, 45), mask(0, 30)]).shared == 0.0


def test_large_masks_are_shrunk_as_photos_are() -> None:
    large = np.zeros((SIDE * 3 // 2, SIDE * 2), np.uint8)
    large[:64] = 255  # 32 rows of the small photo
    found = of([large, large.T[: SIDE * 2]], [(0, 1)])
    assert found.shared == pytest.approx(32 / POINTS)  # the second holds columns 0 to 31: all
