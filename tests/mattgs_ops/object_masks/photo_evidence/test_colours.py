"""Colours cut masks anew where photos and maps both support it, and nowhere else."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from mattgs_ops.object_masks.photo_evidence.colours import (
    by_colours,
    cut_by_colours,
    share_alike,
)
from mattgs_ops.object_masks.silhouettes import iou

SIDE, VIEWS = 160, 6
Pictures = list[np.ndarray]


def ring(view: int) -> np.ndarray:
    """Return a thing with an opening [H, W] in {0, 1}, elsewhere in every view."""
    mask = np.zeros((SIDE, SIDE), np.float32)
    middle = 70 + 4 * view, 80
    cv2.circle(mask, middle, 50, 1.0, -1)
    cv2.rectangle(mask, (middle[0] - 18, 70), (middle[0] + 18, 110), 0.0, -1)
    return mask


def photo_of(mask: np.ndarray, noise: float) -> np.ndarray:
    """Make a dark thing on white paper, with noise."""
    photo = np.where(mask[..., None] > 0, (60, 50, 90), (225, 228, 226)).astype(np.float32)
    photo += np.random.default_rng(0).normal(0, noise, photo.shape)
    return photo.clip(0, 255).astype(np.uint8)


def filled(mask: np.ndarray) -> np.ndarray:
    """Return a map by votes: it takes the opening's lower half for object, and is unsure of it."""
    soft = cv2.GaussianBlur(0.95 * mask, (0, 0), 1.5)
    hole = (mask == 0) & (cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((61, 61))) > 0)
    hole[:90] = False
    return np.where(hole, 0.7, soft).astype(np.float32)


@pytest.mark.parametrize("threads", [1, 3])
def test_what_is_paper_by_colour_is_cut_away(threads: int) -> None:
    truths = [ring(view) for view in range(VIEWS)]
    photos = [photo_of(mask, 3) for mask in truths]
    agreed = [filled(mask) for mask in truths]
    trained = [True] * (VIEWS - 1) + [False]  # a held-out view is cut, too
    found, maps = cut_by_colours(photos, truths, agreed, trained, threads=threads)
    assert found is not None
    assert found.used
    assert found.on_edges[1] > found.on_edges[0]
    assert found.own_maps[1] > found.own_maps[0]
    for photo, soft, cut, true in zip(photos, agreed, maps, truths, strict=True):
        assert np.array_equal(cut, by_colours(photo, soft))
        assert iou(cut >= 0.5, true > 0) > 0.95 > iou(soft >= 0.5, true > 0)


def test_nothing_is_cut_where_maps_would_be_met_less() -> None:
    truths = [ring(view) for view in range(VIEWS)]
    photos = [photo_of(mask, 3) for mask in truths]
    agreed = [filled(mask) for mask in truths]
    found, maps = cut_by_colours(photos, agreed, agreed, [True] * VIEWS)
    assert found is not None
    assert not found.used
    assert all(a is b for a, b in zip(maps, agreed, strict=True))


def test_outlines_that_lie_on_edges_need_nothing() -> None:
    truths = [ring(view) for view in range(VIEWS)]
    photos = [photo_of(mask, 3) for mask in truths]
    found, maps = cut_by_colours(photos, truths, truths, [True] * VIEWS)
    assert found is None
    assert all(a is b for a, b in zip(maps, truths, strict=True))


def test_held_out_views_are_not_compared() -> None:
    truths = [ring(view) for view in range(VIEWS)]
    photos = [photo_of(mask, 3) for mask in truths]
    agreed = [*truths[:3], *map(filled, truths[3:])]
    trained = [True] * 3 + [False] * 3
    assert cut_by_colours(photos, truths, agreed, trained)[0] is None
    assert cut_by_colours(photos, truths, agreed, trained[::-1])[0] is not None


def test_a_colour_is_the_things_where_more_of_the_thing_has_it() -> None:
    thing, part, around = (np.zeros((SIDE, SIDE), bool) for _ in range(3))
    thing[20:60, 20:60], part[60:80, 20:60], around[80:] = True, True, True
    photo = np.full((SIDE, SIDE, 3), 200, np.uint8)
    photo[thing] = (30, 60, 140)
    photo[60:75, 20:60] = (30, 60, 140)  # three quarters of the part
    assert share_alike(photo, thing, part, around) == 0.75
    assert share_alike(photo, thing, part, np.zeros_like(around)) == 0


def test_share_alike_is_what_a_loop_over_pixels_finds() -> None:
    rng = np.random.default_rng(4)
    photo = rng.integers(0, 255, (40, 40, 3), np.uint8)
    masks = [np.arange(1600).reshape(40, 40) % 3 == k for k in range(3)]
    lab = cv2.cvtColor(photo, cv2.COLOR_RGB2LAB).astype(int) // 16
    counts = []
    for mask in (masks[0], masks[2]):
        cells = np.zeros((16, 16, 16))
        for place in lab[mask]:
            cells[*place] += 1
        counts.append(gaussian_filter(cells, 1.0) / mask.sum())
    wanted = np.mean([counts[0][*place] > counts[1][*place] for place in lab[masks[1]]])
    assert share_alike(photo, *masks) == wanted
