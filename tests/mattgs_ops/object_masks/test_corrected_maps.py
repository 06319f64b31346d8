"""Own maps are averaged with what the other views say, each by the odds that it is right."""

from dataclasses import replace

import numpy as np
import pytest

from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.corrected_maps import averaged, corrected, corrected_by_all, unless
from mattgs_ops.object_masks.decision import decide
from mattgs_ops.object_masks.silhouettes import Silhouettes, iou, resized
from tests.mattgs_ops.object_masks.ball import CENTRE, HEIGHT, VIEWS, WIDTH
from tests.mattgs_ops.object_masks.test_decision import (
    CAMERAS,
    TRUTHS,
    grown,
    photos,
    views_of,
    votes,
)

ALL = slice(None)
BARELY = 0.51  # of a map that calls it object, and leaves it to others


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


@pytest.mark.parametrize("plain", [True, False])
def test_on_plain_ground_no_part_joins_that_the_map_saw_nothing_of(plain: bool) -> None:
    """What all other views call object lies apart: a chart there, elsewhere maybe a missed part."""
    own, everyone = _even(0), _even(0)
    own[5:25, 5:25] = 1
    everyone[5:25, 5:28] = everyone[30:38, 30:38] = 1
    found = corrected_by_all(
        [own],
        [everyone],
        votes([everyone], [everyone]),
        0.9,
        averaged([own], [everyone], 0.5, 0.9),
        alone=plain,
    )[0]
    assert (found[5:25, 5:28] >= 0.5).all(), "what touches the map's own joins"
    assert bool((found[32:36, 32:36] >= 0.5).all()) is not plain


def test_a_map_is_replaced_by_another() -> None:
    first, second = [_even(0), _even(0)], [_even(1), _even(1)]
    found = unless([True, False], first, second)
    assert [float(one.mean()) for one in found] == [1, 0]


def test_maps_take_the_size_of_others() -> None:
    (found,) = resized([_even(0.25)], [np.zeros((30, 50), np.float32)])
    assert found.shape == (30, 50)
    np.testing.assert_allclose(found, 0.25)


def test_maps_stay_where_correcting_them_leads_outlines_away_from_edges() -> None:
    """Silhouettes lie beside the ball, by more in some views than in others."""
    beside = [np.roll(t, 6 + index % 2, axis=1) for index, t in enumerate(TRUTHS)]
    met = [iou(a > 0, b > 0) for a, b in zip(beside, TRUTHS, strict=True)]
    own = [*TRUTHS[:-1], TRUTHS[-1] * 0]
    floods = [grown(t, 20) for t in TRUTHS]
    found, maps = decide(
        views_of(photos(), own, Silhouettes(beside, met, 1.0)),
        replace(votes(TRUTHS, floods), agreement=votes(own[:-1], floods[:-1]).agreement),
    )
    assert found.masks == "maps"
    assert found.own_kept
    assert all(np.array_equal(a, b) for a, b in zip(maps[:-1], own[:-1], strict=True))
    assert (maps[-1] >= 0.5).any()  # the others lend an empty map theirs


@pytest.mark.parametrize("right", [True, False])
def test_maps_stay_where_correcting_them_makes_maps_that_agree_less(right: bool) -> None:
    """Votes take away what maps are unsure of: a side of the ball, or a leak, in each view another.

    All is an edge in these photos, which cannot tell.
    """
    own, cut = [], []
    for index, (soft, camera) in enumerate(zip(TRUTHS, CAMERAS, strict=True)):
        unsure, taken = soft.copy(), soft.copy()
        column, row = camera.project(CENTRE[None])[0][0].astype(int)
        if right:
            left, beyond = slice(None, column - 4), slice(column + 5, None)
            above, below = slice(None, row - 4), slice(row + 5, None)
            side = [(ALL, left), (ALL, beyond), (above, ALL), (below, ALL)][index % 4]
            unsure[side] *= BARELY
            taken[side] = 0
        else:
            unsure[8 + index : 40 + index, slice(16) if index % 2 else slice(-16, None)] = BARELY
        own.append(unsure)
        cut.append(taken)
    speckled = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    outlines = Silhouettes([t.copy() for t in TRUTHS], [0.95] * VIEWS, 1.0)
    views = views_of([speckled] * VIEWS, own, outlines, plain=True)
    found, maps = decide(views, replace(votes(own, cut), agreement=[0.1] * VIEWS))
    assert found.masks == "maps"
    assert found.own_kept is right
    scores = [iou(a >= 0.5, b >= 0.5) for a, b in zip(maps, TRUTHS, strict=True)]
    assert min(scores) > 0.97, scores
