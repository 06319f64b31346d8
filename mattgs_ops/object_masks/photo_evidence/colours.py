"""Colours: masks cut anew where photos and maps both support it; what looks like the object.

On even ground splats fill the air as they please: what lies between a rover's wheels is object by
votes and white paper in the photo. GrabCut, seeded by what a map is sure about
(``segment.grabcut``), tells the two apart by colour. On cluttered desks it takes things along that
look alike. The true masks are unknown, so two measures must agree: the new outlines lie on the
photos' edges more, view by view, and the new masks meet the photos' own maps at least as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from mattgs_ops.capture.masks import HALF, SoftMap, clean
from mattgs_ops.object_masks.photo_evidence.edges import edges_near, share_on_edges
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.silhouettes import overlaps
from mattgs_ops.parallel import over_views
from mattgs_ops.segment.grabcut import grabcut_seeded

GOOD = 0.99  # share of outlines on edges from which on there is nothing to mend
SURE = 0.8  # of a map, and 1 - SURE for background: colours decide only what lies between
BINS = 16  # of each axis of CIELAB; neighbours are blurred into each other, by one bin
FEWEST_PIXELS = 20  # of a colour histogram, and of what is compared with it
MOST_VIEWS = 24  # that are compared: a t-test gains little from more, and each takes 0.15 s

Bits = NDArray[np.bool_]


@dataclass(frozen=True)
class ColourEvidence:
    """Before and after the cut, means over views: outlines on edges, IoU with the own maps."""

    used: bool
    on_edges: tuple[float, float]
    own_maps: tuple[float, float]


def cut_by_colours(
    photos: Sequence[NDArray[np.uint8]],
    own: Sequence[SoftMap],
    agreed: Sequence[SoftMap],
    trained: Sequence[bool],
    *,
    threads: int = 1,
) -> tuple[ColourEvidence | None, list[SoftMap]]:
    """Return what the cut by colours changes, and the agreed maps, corrected where that helps.

    ``photos`` [H, W, 3] RGB, ``own`` and ``agreed`` maps [H, W] in [0, 1] are all of one size. Only
    views that are ``trained`` on are compared, at most :data:`MOST_VIEWS`, evenly. None where the
    outlines need nothing.
    """
    training = [index for index, use in enumerate(trained) if use]
    count = min(len(training), MOST_VIEWS)
    compared = [training[k * len(training) // count] for k in range(count)]
    edges = [edges_near(photos[index]) for index in compared]
    before = [_cleaned(agreed[index]) for index in compared]
    shares = [share_on_edges(mask > 0, edge) for mask, edge in zip(before, edges, strict=True)]
    if np.mean(shares) >= GOOD:
        return None, list(agreed)

    def cut(views: list[int]) -> dict[int, SoftMap]:
        pairs = [photos[k] for k in views], [agreed[k] for k in views]
        return dict(zip(views, over_views(by_colours, *pairs, threads=threads), strict=True))

    corrected = cut(compared)
    after = [_cleaned(corrected[index]) for index in compared]
    moved = [share_on_edges(mask > 0, edge) for mask, edge in zip(after, edges, strict=True)]
    mine = [own[index] for index in compared]
    overlap = [float(np.mean(overlaps(mine, masks))) for masks in (before, after)]
    found = ColourEvidence(
        used=overlap[1] >= overlap[0] and surely_larger(moved, shares),
        on_edges=(float(np.mean(shares)), float(np.mean(moved))),
        own_maps=(overlap[0], overlap[1]),
    )
    if not found.used:
        return found, list(agreed)
    corrected |= cut([k for k in range(len(agreed)) if k not in corrected])
    return found, [corrected[k] for k in range(len(agreed))]


def by_colours(photo: NDArray[np.uint8], soft: SoftMap) -> SoftMap:
    """Correct a map [H, W] in [0, 1] by the colours of its photo [H, W, 3] RGB.

    Where colours differ from it the map is mirrored about a half; elsewhere it stays. What it is
    sure about stays as well, thin parts included, which have no inside to learn colours from.
    """
    cut = grabcut_seeded(photo, soft)
    cut[soft >= SURE] = 255
    cut[soft <= 1 - SURE] = 0
    corrected: SoftMap = np.where((cut > 0) == (soft >= HALF), soft, 1 - soft).astype(np.float32)
    return corrected


def share_alike(photo: NDArray[np.uint8], thing: Bits, part: Bits, around: Bits) -> float:
    """Return the share of a part's pixels whose colour is the thing's rather than the rest's.

    ``photo`` [H, W, 3] RGB; ``thing``, ``part`` and ``around`` [H, W] do not overlap. A colour is
    the thing's where the histogram of the thing holds a larger share of it than that of what is
    ``around``. 0 where one of the three is too small to say.
    """
    if min(int(mask.sum()) for mask in (thing, part, around)) < FEWEST_PIXELS:
        return 0.0
    places = cv2.cvtColor(photo, cv2.COLOR_RGB2LAB).astype(np.int64) * BINS // 256
    mine, others = _histogram(places[thing]), _histogram(places[around])
    colours = tuple(places[part].T)
    return float((mine[colours] > others[colours]).mean())


def _histogram(places: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the smoothed share of each colour [BINS, BINS, BINS] among ``places`` [N, 3]."""
    counts, _ = np.histogramdd(places, bins=BINS, range=[(0, BINS)] * 3)
    shares: NDArray[np.float64] = gaussian_filter(counts, 1.0) / len(places)
    return shares


def _cleaned(soft: SoftMap) -> SoftMap:
    """Threshold and clean a map as masks are that are delivered."""
    return (clean(np.where(soft >= HALF, 255, 0).astype(np.uint8)) > 0).astype(np.float32)
