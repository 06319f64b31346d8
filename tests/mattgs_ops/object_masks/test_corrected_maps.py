"""Own maps are averaged with what the other views say, each by the odds that it is right."""

import numpy as np
import pytest

from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.corrected_maps import averaged, corrected, unless
from mattgs_ops.object_masks.silhouettes import resized


def _even(value: float) -> SoftMap:
    return np.full((40, 40), value, np.float32)


@pytest.mark.parametrize(
    ("own_right", "votes_right", "share"),
    [
        (0.8, 0.8, 0.5),
        (0.8, 0.5, 0.2),  # odds of 4 against 1
        (0.5, 0.9, 0.5),  # a map weighs no less than what corrects it
        (1.0, 0.0, 0.0),
    ],
)
def test_votes_count_by_their_odds_and_no_more_than_the_own_map(
    own_right: float, votes_right: float, share: float
) -> None:
    (found,) = averaged([_even(0)], [_even(1)], own_right, votes_right)
    np.testing.assert_allclose(found, share, atol=1e-6)


def test_what_lies_outside_other_silhouettes_counts_twice() -> None:
    """Inside them may be free space; outside them nothing is, if they are right."""
    blank = _even(0)
    (outside,) = corrected([_even(1)], [_even(0)], [_even(0)], 0.5, 0.0, [blank])
    (lent,) = corrected([_even(0)], [_even(1)], [_even(0)], 0.5, 0.0, [blank])
    np.testing.assert_allclose(outside, 1 / 3, atol=1e-6)
    np.testing.assert_allclose(lent, 1 / 2, atol=1e-6)


def test_along_its_outline_a_map_follows_what_is_more_exact() -> None:
    own, exact = _even(0), _even(0.75)
    own[:, :20] = 1
    (found,) = corrected([own], [own], [own], 0.9, 0.9, [exact])
    np.testing.assert_array_equal(found[:, 19:21], 0.75)
    np.testing.assert_allclose(found[:, :10], 1, atol=1e-6)
    np.testing.assert_allclose(found[:, 30:], 0, atol=1e-6)


def test_the_outline_of_a_part_that_no_other_shows_goes_with_the_part() -> None:
    own = _even(0)
    own[:, :20] = 1
    (found,) = corrected([own], [_even(0)], [_even(0)], 0.9, 0.9, [own])
    assert (found < 0.5).all()


def test_a_map_is_replaced_by_another() -> None:
    first, second = [_even(0), _even(0)], [_even(1), _even(1)]
    found = unless([True, False], first, second)
    assert [float(one.mean()) for one in found] == [1, 0]


def test_maps_take_the_size_of_others() -> None:
    (found,) = resized([_even(0.25)], [np.zeros((30, 50), np.float32)])
    assert found.shape == (30, 50)
    np.testing.assert_allclose(found, 0.25)
