"""Masks contradict each other where points that two photos share lie in one of them alone."""

import numpy as np
import pytest

from mattgs_ops.segment.contradictions import FEWEST_POINTS, Contradictions, contradictions

POINTS = 40
# a column of points, from the top; the middle of a pixel is at a half
PLACES = np.stack([np.full(POINTS, 10.5), np.arange(POINTS) + 0.5], axis=1)


def pair(count: int = POINTS, moved: int = 0) -> np.ndarray:
    """Return a pair's points, which lie farther down in the second photo."""
    return np.stack([PLACES[:count], PLACES[:count] + np.array([0, moved])], axis=1)


def mask(first: int, last: int) -> np.ndarray:
    """Return a mask that holds the points ``first`` to ``last`` of the column."""
    pixels = np.zeros((60, 80), np.uint8)
    pixels[first:last] = 255
    return pixels


def test_points_outside_both_masks_say_nothing() -> None:
    found = contradictions({(0, 1): pair()}, [mask(0, 32), mask(0, 32)])
    assert found == Contradictions(1.0, ())


def test_the_share_is_of_points_in_either_mask() -> None:
    found = contradictions({(0, 1): pair()}, [mask(0, 30), mask(10, 40)])
    assert found == Contradictions(0.5, ())  # 20 in both, 20 in one alone: no contradiction yet


def test_more_points_in_one_mask_alone_than_in_both_contradict() -> None:
    found = contradictions({(0, 1): pair()}, [mask(0, 30), mask(11, 40)])
    assert found.shared == pytest.approx(19 / 40)
    assert found.views == (0,)  # without its points nothing speaks against the other


def test_few_points_say_nothing_of_a_mask() -> None:
    masks = [mask(0, 40), mask(0, 0)]
    assert contradictions({(0, 1): pair(FEWEST_POINTS)}, masks) == Contradictions(0.0, (0,))
    assert contradictions({(0, 1): pair(FEWEST_POINTS - 1)}, masks) == Contradictions(None, ())


def test_a_capture_of_which_half_the_photos_share_points_is_known() -> None:
    masks = [mask(0, 40)] * 4
    assert contradictions({(0, 1): pair()}, masks).shared == 1.0
    assert contradictions({(0, 1): pair()}, [*masks, mask(0, 40)]).shared is None
    assert contradictions({}, masks) == Contradictions(None, ())


def test_one_wrong_mask_is_named_and_not_those_that_it_contradicts() -> None:
    """Photo 1 has another part than the four others, of which each is matched with it and one."""
    masks = [mask(0, 20)] * 5
    masks[1] = mask(20, 40)
    linked = [(0, 1), (1, 2), (1, 3), (1, 4), (0, 2), (3, 4)]
    found = contradictions(dict.fromkeys(linked, pair()), masks)
    assert found.views == (1,)
    assert found.shared == pytest.approx(40 / (4 * 40 + 40))


def test_a_point_s_place_is_read_in_its_own_photo() -> None:
    shifted = {(0, 1): pair(moved=15)}
    assert contradictions(shifted, [mask(0, 30), mask(15, 45)]) == Contradictions(1.0, ())
    assert contradictions(shifted, [mask(15, 45), mask(0, 30)]).shared == 0.0


def test_a_point_beside_the_frame_lies_in_no_mask() -> None:
    """As of a photo whose lens was straightened: some key points leave it."""
    outside = {(0, 1): pair(moved=25)}  # five of 40 leave at the bottom
    assert contradictions(outside, [mask(0, 60), mask(0, 60)]).shared == pytest.approx(35 / 40)
    above = {(0, 1): pair(moved=-5)}
    assert contradictions(above, [mask(0, 60), mask(0, 60)]).shared == pytest.approx(35 / 40)
