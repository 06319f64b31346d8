"""How far outlines overlap a photo's map and lie on its edges."""

from collections.abc import Sequence

import numpy as np
import pytest

from mattgs_ops.object_masks.map_scores import (
    MOST_ATTACHED,
    ViewMaps,
    choose_parts,
    parts_that_join,
)
from mattgs_ops.object_masks.silhouettes import Silhouettes
from tests.mattgs_ops.object_masks.ball import orbit

SIDE, VIEWS = 60, 4
THING, BESIDE = (slice(20, 40), slice(10, 30)), (slice(24, 36), slice(30, 42))


def box(*places: tuple[slice, slice]) -> np.ndarray:
    soft = np.zeros((SIDE, SIDE), np.float32)
    for place in places:
        soft[place] = 1
    return soft


def photo_of(mask: np.ndarray, colour: tuple[int, int, int] = (200, 160, 90)) -> np.ndarray:
    return (mask[..., None] * np.array(colour)).astype(np.uint8)


def views_of(
    own: list[np.ndarray],
    photos: list[np.ndarray],
    trained: Sequence[bool] | None = None,
    *,
    plain: bool = False,
) -> ViewMaps:
    """Make views whose silhouettes, smaller than the maps, meet the own maps."""
    names = [f"{index}.jpg" for index in range(len(own))]
    smaller = [one[::2, ::2] for one in own]
    met = Silhouettes(smaller, [1.0] * len(own), 1.0)
    return ViewMaps.of(names, photos, own, met, orbit(), trained, plain_ground=plain)


def test_an_outline_on_the_photos_edge_scores_and_one_on_even_cloth_does_not() -> None:
    true, away = box(THING), box((slice(10, 50), slice(2, 48)))
    found = views_of([true, true], [photo_of(true)] * 2).score([true, away])
    assert found.on_edges == [1.0, 0.0]
    assert found.overlap[0] == 1.0
    assert found.overlap[1] == pytest.approx(true.sum() / away.sum())
    assert found.mean_on_edges([0]) == 1.0
    assert found.mean_on_edges([0, 1]) == 0.5
    assert found.area([0]) == pytest.approx(true.mean())


@pytest.mark.parametrize("shown", [True, False])
def test_a_part_that_no_map_shows_joins_where_the_photos_show_it(shown: bool) -> None:
    own, whole = [box(THING)] * VIEWS, [box(THING, BESIDE)] * VIEWS
    photos = [photo_of(whole[0] if shown else own[0])] * VIEWS
    views = views_of(own, photos)
    found = parts_that_join(views, views.own, views.score(whole))
    assert found.added == pytest.approx(12 * 12 / 20**2)
    assert found.added < MOST_ATTACHED
    assert found.alike is None
    assert found.join is shown


@pytest.mark.parametrize("alike", [True, False])
def test_parts_larger_than_half_of_the_thing_join_where_they_have_its_colours(alike: bool) -> None:
    core, whole = box(THING), box((slice(20, 40), slice(10, 50)))
    shade = (200, 160, 90) if alike else (90, 90, 90)
    photo = np.where(core[..., None] > 0, photo_of(core), photo_of(whole, shade))
    photo[45:, :] = (90, 90, 90)  # the rest of the photo has that grey, too
    photos = [photo] * VIEWS
    views = views_of([core] * VIEWS, photos)
    both = views.score([whole] * VIEWS)
    found = parts_that_join(views, views.own, both)
    assert found.added == pytest.approx(1.0)
    assert found.alike == (1.0 if alike else 0.0)
    assert found.join is alike
    on_cloth = parts_that_join(views_of([core] * VIEWS, photos, plain=True), views.own, both)
    assert (on_cloth.added, on_cloth.join, on_cloth.alike) == (found.added, False, None)


def test_clear_parts_join_where_not_all_do() -> None:
    """The photos show a part beside the thing; what else would join has no edge there."""
    thing, part = box(THING), box(THING, BESIDE)
    flood = box(THING, BESIDE, (slice(2, 58), slice(2, 58)))
    views = views_of([thing] * VIEWS, [photo_of(part)] * VIEWS)
    certain, whole, all_parts = (views.score([one] * VIEWS) for one in (thing, part, flood))
    found, clear_alone = choose_parts(views, certain, whole.maps, all_parts)
    assert (found.join, clear_alone, found.scores) == (True, True, whole)
    # all join where they may, and what clear parts do not add is told of all of them
    assert choose_parts(views, certain, certain.maps, whole)[1] is False
    refused, clear_alone = choose_parts(views, certain, certain.maps, all_parts)
    assert (refused.join, clear_alone, refused.scores) == (False, False, all_parts)


def test_views_that_are_not_trained_on_change_nothing() -> None:
    own, whole = [box(THING)] * VIEWS, [box(THING, BESIDE)] * VIEWS
    shown, hidden = photo_of(whole[0]), photo_of(own[0])
    photos = [shown, shown, hidden, hidden]
    for first_two, joins in ((True, True), (False, False)):
        views = views_of(own, photos, [first_two] * 2 + [not first_two] * 2)
        assert parts_that_join(views, views.own, views.score(whole)).join is joins


def test_before_votes_own_maps_are_compared_with_edges_and_silhouettes() -> None:
    own = [box(THING)] * 2 + [box()] * 2
    views = views_of(own, [photo_of(own[0]), photo_of(own[2])] * 2, [False, True, True, True])
    assert views.own.on_edges == [1.0, 0.0, 0.0, 0.0]  # only the first photo shows the thing
    pairs = zip(views.predicted, own, strict=True)
    assert all(np.array_equal(a >= 0.5, b >= 0.5) for a, b in pairs)
    assert views.by_outline == [1.0] * 4
    assert views.trained_views == [1, 2, 3]
    assert views.with_object == [1]
    assert views.score([box(BESIDE)] * 4).overlap == [0.0] * 4
