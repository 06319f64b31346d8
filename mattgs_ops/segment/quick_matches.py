"""Which photos show the same, and where: SIFT key points of small photos, matched by pairs.

Neighbours by name are compared, and some photos beyond. Matches of two photos count where they lie
on epipolar lines that most of them agree on. It takes a share of a second a photo, as all is done
at :data:`SIDE` pixels; ``sfm`` matches whole photos.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mattgs_ops.capture.mask_files import THRESHOLD

SIDE = 480  # pixels of the longest side at which photos are matched
FEATURES = 1500  # SIFT key points a photo
RATIO = 0.8  # Lowe 2004: nearest against second nearest
FEWEST_INLIERS = 15  # COLMAP's own, of two views' geometry
LOOSE = 2.0  # pixels from an epipolar line, at SIDE; what moves less is in the same place
AROUND = 4  # neighbours by name that a photo is matched with, to either side
STRIDE = 7  # and every so-many-th photo beyond them: walks go around more than once
AROUND_POINT = 4  # pixels, deviation of the blur through which a matched point's light is read
SEED = 0

Grey = NDArray[np.uint8]
Floats = NDArray[np.float64]
Pair = tuple[int, int]  # of photos, by their indices


@dataclass(frozen=True)
class KeyPoints:
    """Key points of a photo, and log2 of the light around them, [N, 2], [N, 128] and [N]."""

    points: NDArray[np.float32]
    descriptors: NDArray[np.float32]
    light: Floats


@dataclass(frozen=True)
class Matches:
    """Two photos of one scene: how far its points moved between them, and how much lighter it got.

    ``moved`` is in pixels, ``stops`` are exposure values by which the second photo is lighter:
    medians over the matches that lie on epipolar lines. ``moving`` counts the matches that moved
    and lie on epipolar lines of their own: those on the object, where the camera stands still.
    ``places`` are the points [M, 2, 2] that lie on either lines, (x, y) in the first photo and in
    the second, in pixels of the small photos; the centre of the top-left one is at (0.5, 0.5).
    """

    moved: float
    stops: float
    moving: int
    places: Floats


def pairs(count: int) -> list[Pair]:
    """Return the pairs of photos to match: neighbours by name, and some beyond, each once."""
    steps = [*range(1, AROUND + 1), *range(AROUND + STRIDE, count, STRIDE)]
    found = {tuple(sorted((i, (i + step) % count))) for i in range(count) for step in steps}
    return sorted((a, b) for a, b in found if a != b)


def key_points(grey: Grey, sift: cv2.SIFT) -> KeyPoints | None:
    """Return a photo's key points; None where there are too few for any match."""
    points, descriptors = sift.detectAndCompute(grey, None)
    if descriptors is None or len(points) < FEWEST_INLIERS:
        return None
    places = np.array([point.pt for point in points], dtype=np.float32)
    light = cv2.GaussianBlur(linear_light(grey), (0, 0), AROUND_POINT)
    column, row = np.round(places).astype(np.int64).T
    row, column = row.clip(0, grey.shape[0] - 1), column.clip(0, grey.shape[1] - 1)
    darkest = linear_light(np.ones(1, np.uint8))[0]
    around = np.log2(np.maximum(light[row, column], darkest)).astype(np.float64)
    return KeyPoints(places, np.asarray(descriptors, dtype=np.float32), around)


def match(features: Sequence[KeyPoints | None]) -> dict[Pair, Matches]:
    """Return the pairs of photos that match.

    Names say little of what photos show. So those that are left outside the largest group are
    compared with all in it, nearest by name first, until one matches; no more pairs than before.
    """
    count = len(features)
    compared = set(pairs(count))
    found = _matching(features, sorted(compared))
    left = len(compared)
    for photo in range(count):
        inside = largest_group(list(found), count)
        if photo in inside:
            continue
        further = {(min(photo, n), max(photo, n)) for n in inside} - compared
        for pair in sorted(further, key=lambda pair: (pair[1] - pair[0], pair))[:left]:
            left -= 1
            joined = _matching(features, [pair])
            found |= joined
            if joined:
                break
    return found


def _matching(
    features: Sequence[KeyPoints | None], compared: Sequence[Pair]
) -> dict[Pair, Matches]:
    """Return those of the pairs that match."""
    found = {}
    for first, second in compared:
        one, other = features[first], features[second]
        both = None if one is None or other is None else _match(one, other)
        if both is not None:
            found[first, second] = both
    return found


def _groups(linked: Sequence[Pair], count: int) -> NDArray[np.int32]:
    """Return for each photo the number of the group that hangs together by pairs."""
    first, second = np.array(linked, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def largest_group(linked: Sequence[Pair], count: int) -> list[int]:
    """Return the photos of the largest group."""
    groups = _groups(linked, count)
    return np.flatnonzero(groups == np.bincount(groups).argmax()).tolist()


def together(linked: Sequence[Pair], count: int) -> tuple[list[int], int]:
    """Return with how many others each photo matches, and the size of the largest group."""
    matched = np.bincount(np.array(linked, dtype=np.int64).ravel(), minlength=count)
    return [int(one) for one in matched], len(largest_group(linked, count))


def _match(first: KeyPoints, second: KeyPoints) -> Matches | None:
    """Match two photos' key points; None where they share too few."""
    found = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first.descriptors, second.descriptors, k=2)
    good = [two[0] for two in found if len(two) == 2 and two[0].distance < RATIO * two[1].distance]
    if len(good) < FEWEST_INLIERS:
        return None
    here, there = [one.queryIdx for one in good], [one.trainIdx for one in good]
    points, others = first.points[here], second.points[there]
    on_lines = _on_lines(points, others)
    if on_lines.sum() < FEWEST_INLIERS:
        return None
    moves = np.linalg.norm(points - others, axis=1)
    lighter = second.light[there] - first.light[here]
    of_moving = np.flatnonzero(moves >= LOOSE)
    of_moving = of_moving[_on_lines(points[of_moving], others[of_moving])]
    on_any = on_lines.copy()
    on_any[of_moving] = True
    return Matches(
        float(np.median(moves[on_lines])),
        float(np.median(lighter[on_lines])),
        len(of_moving),
        np.stack([points[on_any], others[on_any]], axis=1).astype(np.float64) + 0.5,  # OpenCV: at 0
    )


def _on_lines(points: NDArray[np.float32], others: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return which matches [N] lie on the epipolar lines that most of them agree on."""
    if len(points) < FEWEST_INLIERS:
        return np.zeros(len(points), dtype=bool)
    cv2.setRNGSeed(SEED)
    inliers = cv2.findFundamentalMat(points, others, cv2.FM_RANSAC, LOOSE, 0.99)[1]
    return np.zeros(len(points), dtype=bool) if inliers is None else inliers.ravel() > 0


def linear_light(grey: Grey) -> NDArray[np.float32]:
    """Return the light, 0 to 1, of 8-bit sRGB values: stops are ratios of light (IEC 61966-2-1)."""
    encoded = np.arange(256) / 255
    light = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.asarray(light[grey], dtype=np.float32)


def shrunk(grey: Grey) -> Grey:
    """Return a photo [H, W] at the size at which photos are matched."""
    size = shrunk_size(grey.shape[1], grey.shape[0])
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def shrunk_size(width: int, height: int) -> tuple[int, int]:
    """Return that size, width and height, of a photo's."""
    factor = min(1.0, SIDE / max(width, height))
    return max(1, round(width * factor)), max(1, round(height * factor))


def shrunk_mask(mask: Grey) -> Grey:
    """Return a mask [H, W], 0 or 255, at that size: object where at least half of a pixel is."""
    return np.where(shrunk(mask) >= THRESHOLD, 255, 0).astype(np.uint8)
