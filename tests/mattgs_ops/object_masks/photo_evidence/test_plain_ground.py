"""A plain ground corrects maps; shadows and cluttered ground correct nothing."""

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.photo_evidence import plain_ground
from mattgs_ops.object_masks.photo_evidence.plain_ground import correct_by_ground, deviations
from mattgs_ops.object_masks.silhouettes import iou

HEIGHT, WIDTH, VIEWS = 120, 160, 4
ROOM = slice(50, 70), slice(70, 90)  # in all photos, inside the frame that the thing is


def frame(view: int) -> np.ndarray:
    """Return a thing with an opening [H, W] in {0, 1}, elsewhere in every view."""
    mask = np.zeros((HEIGHT, WIDTH), np.float32)
    mask[30:110, 45 + view : 120 + view] = 1
    mask[ROOM] = 0
    return mask


def photo_of(mask: np.ndarray, ground: np.ndarray, seed: int) -> np.ndarray:
    """Make a reddish thing on a ground [H, W], with noise, as RGB."""
    photo = np.where(mask[..., None] > 0, (150, 70, 60), ground[..., None]).astype(np.float32)
    photo += np.random.default_rng(seed).normal(0, 1.5, photo.shape)
    return photo.clip(0, 255).astype(np.uint8)


def sloping() -> np.ndarray:
    """Return light that falls off to the right and to the corners [H, W]."""
    y, x = np.mgrid[-1 : 1 : HEIGHT * 1j, -1 : 1 : WIDTH * 1j]
    return 60 - 15 * x - 8 * (x**2 + y**2)


def filled(mask: np.ndarray) -> np.ndarray:
    """Return a map that takes the opening for object, and is soft at the outline."""
    soft = mask.copy()
    soft[ROOM] = 0.97
    return cv2.GaussianBlur(0.98 * soft, (0, 0), 1.5)


def scores(maps: list[np.ndarray], truths: list[np.ndarray]) -> list[float]:
    return [iou(soft >= 0.5, truth > 0) for soft, truth in zip(maps, truths, strict=True)]


def test_an_opening_that_shows_the_ground_is_cut_out() -> None:
    truths = [frame(view) for view in range(VIEWS)]
    photos = [photo_of(mask, sloping(), view) for view, mask in enumerate(truths)]
    maps = [filled(mask) for mask in truths]
    found, corrected = correct_by_ground(photos, maps, [True, True, True, False])
    assert found.used
    assert max(scores(maps, truths)) < 0.95
    assert min(scores(corrected, truths)) > 0.98


def test_a_part_that_the_map_hardly_sees_joins() -> None:
    truths = [frame(view) for view in range(VIEWS)]
    photos = [photo_of(mask, sloping(), view) for view, mask in enumerate(truths)]
    maps: list[SoftMap] = [np.float32(0.98) * mask for mask in truths]
    for soft in maps:
        soft[30:110, 45:58] *= 0.3
    _, corrected = correct_by_ground(photos, maps, [True] * VIEWS)
    assert min(scores(corrected, truths)) > 0.97 > max(scores(maps, truths))


CHART = slice(60, 72), slice(6, 24)  # beside the thing


@pytest.mark.parametrize("seen", [0, 4])
def test_a_chart_beside_the_thing_does_not_join(seen: int) -> None:
    """It is as red as the thing, and a map that sees a corner of it does not take it for object."""
    truths = [frame(view) for view in range(VIEWS)]
    shown = [mask.copy() for mask in truths]
    for mask in shown:
        mask[CHART] = 1
    photos = [photo_of(mask, sloping(), view) for view, mask in enumerate(shown)]
    maps: list[SoftMap] = [np.float32(0.98) * mask for mask in truths]
    for soft in maps:
        soft[CHART] = 0.1
        soft[60:72, 6 : 6 + seen] = 0.9
    found, corrected = correct_by_ground(photos, maps, [True] * VIEWS)
    assert found.used
    for soft, own in zip(corrected, maps, strict=True):
        assert (soft[CHART] >= 0.5).sum() <= 12 * seen
        assert iou(soft >= 0.5, own >= 0.5) > 0.97


def test_a_map_that_sees_nothing_gets_what_is_no_ground() -> None:
    truths = [frame(view) for view in range(VIEWS)]
    photos = [photo_of(mask, sloping(), view) for view, mask in enumerate(truths)]
    maps: list[SoftMap] = [np.float32(0.98) * mask for mask in truths]
    maps[-1] = np.float32(0.3) * truths[-1]
    _, corrected = correct_by_ground(photos, maps, [True] * VIEWS)
    assert min(scores(corrected, truths)) > 0.97


def test_a_shadow_is_no_object() -> None:
    truths = [frame(view) for view in range(VIEWS)]
    ground = sloping()
    ground[98:118, 125:155] *= 0.4
    photos = [photo_of(mask, ground, view) for view, mask in enumerate(truths)]
    maps: list[SoftMap] = [np.float32(0.98) * mask for mask in truths]
    for soft in maps:
        soft[98:118, 125:155] = 0.3
    found, corrected = correct_by_ground(photos, maps, [True] * VIEWS)
    assert found.used
    assert min(scores(corrected, truths)) > 0.97


def test_clutter_that_looks_like_the_thing_corrects_nothing() -> None:
    truths = [frame(view) for view in range(VIEWS)]
    speckles = np.random.default_rng(5).uniform(0, 255, (VIEWS, HEIGHT, WIDTH, 3))
    photos = [cv2.GaussianBlur(one, (0, 0), 2).astype(np.uint8) for one in speckles]
    maps = [filled(mask) for mask in truths]
    found, corrected = correct_by_ground(photos, maps, [True] * VIEWS)
    assert not found.used
    assert found.overlap > plain_ground.LARGEST_OVERLAP
    assert all(one is soft for one, soft in zip(corrected, maps, strict=True))


def test_held_out_views_are_not_counted() -> None:
    truths = [frame(view) for view in range(VIEWS)]
    photos = [photo_of(mask, sloping(), view) for view, mask in enumerate(truths)]
    maps = [filled(mask) for mask in truths]
    trained = [True, True, True, False]
    expected, before = correct_by_ground(photos, maps, trained)
    photos[3] = np.random.default_rng(3).integers(0, 255, photos[3].shape, dtype=np.uint8)
    found, after = correct_by_ground(photos, maps, trained)
    assert found == expected
    assert all(np.array_equal(after[k], before[k]) for k in range(3))


@pytest.mark.parametrize("soft", [0.0, 1.0])
def test_without_an_object_or_a_ground_maps_stay(soft: float) -> None:
    maps = [np.full((HEIGHT, WIDTH), soft, np.float32)] * VIEWS
    photos = [photo_of(frame(0), sloping(), view) for view in range(VIEWS)]
    found, corrected = correct_by_ground(photos, maps, [True] * VIEWS)
    assert not found.used
    assert all(one is soft for one, soft in zip(corrected, maps, strict=True))


def test_the_ground_is_fitted_without_what_stands_on_it_unseen() -> None:
    """A second thing, which the map misses, must not bend the ground: reference is the true one."""
    ground = sloping()
    photo = photo_of(frame(0), ground, 0)
    photo[5:25, 5:25] = (200, 30, 30)
    soft = filled(frame(0))
    bins = deviations(photo, soft)
    assert bins is not None
    middle = int(np.digitize(0, plain_ground.LIGHTNESS[1:-1])) * (len(plain_ground.HUE) - 1)
    even = np.ones((HEIGHT, WIDTH), bool)
    even[3:27, 3:27] = False
    even[frame(0) > 0] = False
    even &= cv2.erode(even.astype(np.uint8), np.ones((5, 5))) > 0
    assert (bins[even] == middle).mean() > 0.8
    assert (bins[8:22, 8:22] != middle).all()
