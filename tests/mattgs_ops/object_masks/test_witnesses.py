"""A photo's map and its edges say of outlines how far they meet them."""

import numpy as np
import pytest

from mattgs_ops.object_masks.photo_evidence.edges import edges_near
from mattgs_ops.object_masks.witnesses import MOST_ATTACHED, Witnessed, judge_parts

SIDE, VIEWS = 60, 4
THING, BESIDE = (slice(20, 40), slice(10, 30)), (slice(24, 36), slice(30, 42))


def box(*places: tuple[slice, slice]) -> np.ndarray:
    soft = np.zeros((SIDE, SIDE), np.float32)
    for place in places:
        soft[place] = 1
    return soft


def photo_of(mask: np.ndarray, colour: tuple[int, int, int] = (200, 160, 90)) -> np.ndarray:
    return (mask[..., None] * np.array(colour)).astype(np.uint8)


def seen(maps: list[np.ndarray], own: list[np.ndarray], photos: list[np.ndarray]) -> Witnessed:
    return Witnessed.of(maps, own, [edges_near(photo) for photo in photos])


def test_an_outline_on_the_photos_edge_is_confirmed_and_one_on_even_cloth_is_not() -> None:
    true, away = box(THING), box((slice(10, 50), slice(2, 48)))
    found = seen([true, away], [true, true], [photo_of(true)] * 2)
    assert found.on_edges == [1.0, 0.0]
    assert found.met[0] == 1.0
    assert found.met[1] == pytest.approx(true.sum() / away.sum())
    assert found.confirmed([0]) == 1.0
    assert found.confirmed([0, 1]) == 0.5
    assert found.area([0]) == pytest.approx(true.mean())


@pytest.mark.parametrize("shown", [True, False])
def test_a_part_that_no_map_claims_joins_where_the_photos_show_it(shown: bool) -> None:
    own, whole = [box(THING)] * VIEWS, [box(THING, BESIDE)] * VIEWS
    photos = [photo_of(whole[0] if shown else own[0])] * VIEWS
    certain, both = seen(own, own, photos), seen(whole, own, photos)
    found = judge_parts(photos, certain, both, range(VIEWS))
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
    certain = seen([core] * VIEWS, [core] * VIEWS, photos)
    both = seen([whole] * VIEWS, [core] * VIEWS, photos)
    found = judge_parts(photos, certain, both, range(VIEWS))
    assert found.added == pytest.approx(1.0)
    assert found.alike == (1.0 if alike else 0.0)
    assert found.join is alike
    on_cloth = judge_parts(photos, certain, both, range(VIEWS), plain_ground=True)
    assert (on_cloth.added, on_cloth.join, on_cloth.alike) == (found.added, False, None)


def test_views_that_do_not_decide_change_nothing() -> None:
    own, whole = [box(THING)] * VIEWS, [box(THING, BESIDE)] * VIEWS
    shown, hidden = photo_of(whole[0]), photo_of(own[0])
    photos = [shown, shown, hidden, hidden]
    certain, both = seen(own, own, photos), seen(whole, own, photos)
    assert judge_parts(photos, certain, both, [0, 1]).join
    assert not judge_parts(photos, certain, both, [2, 3]).join
