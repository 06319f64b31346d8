"""Which pairs of views to compare, their matches, and what epipolar geometry leaves of them.

Descriptors are compared by brute force: nearest neighbour in both directions (cross check) and
Lowe's ratio test, by angle between descriptors as in COLMAP's own matcher, which finds the same.
Inner products are sums of whole numbers (``_kernels/nearest.cpp``), so that neither the processor
nor the number of threads changes a match. Verification is COLMAP's, seeded. Worker process only.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap import _descriptors
from mattgs_ops.sfm.colmap.features import Matches, Pair
from mattgs_ops.sfm.colmap.moving_object import ObjectMatches, object_matches

RATIO, FARTHEST = 0.8, 0.7  # COLMAP's defaults: Lowe's ratio, and the largest angle in radians
DESCRIPTOR_LENGTH = 512.0  # SIFT descriptors are unit vectors times 512, rounded
LEAST_MATCHES = 15  # COLMAP's default for keeping a pair
OVERLAP = 10  # neighbours in a sequence that are always compared
# Pairs per view chosen by similarity, beside a sequence's and where nothing else chooses. On the
# bundled hexapod 24 hold 87 % of all matches in two fifths of the pairs, 12 hold 71 %.
SIMILAR_BESIDE, SIMILAR_ALONE = 12, 24
# Share of a sequence's views that are followed by a similar one, as many as must be placed
# (lost_views): four walks and videos of 125 to 215 photos have 0.98 to 1.00, two of them shuffled
# 0.12 and 0.28
FOLLOWED = 0.95
PREVIEW_FEATURES = 512  # the largest-scale features repeat best (Wu 2013, preemptive matching)
# Farther apart than this, two views of one object share next to nothing that SIFT can match.
WIDEST_ANGLE = 75.0
STILL_SHARE = 2 / 480  # of the longest side: what moves less is in the same place (quick_matches)


@dataclass(frozen=True)
class Verified:
    """A pair's geometry as COLMAP estimates it, its inlier matches [M, 2], and the object's.

    ``beside`` counts the matches that lie outside both masks.
    """

    geometry: Any  # pycolmap.TwoViewGeometry
    matches: Matches
    on_object: ObjectMatches | None = None
    beside: int = 0


def stand_still(
    pairs: Mapping[Pair, Verified], positions: Sequence[NDArray[np.float64]], sides: Sequence[int]
) -> bool:
    """Whether the camera does: in more than half of the pairs more than half of the matches stay.

    ``positions`` are the views' key points [K, 2] in pixels, ``sides`` the photos' longest ones.
    """
    still = 0
    for (a, b), found in pairs.items():
        here, there = positions[a][found.matches[:, 0]], positions[b][found.matches[:, 1]]
        moved = np.linalg.norm(here - there, axis=1)
        still += bool(np.median(moved) < STILL_SHARE * max(sides[a], sides[b]))
    return still > len(pairs) / 2


def exhaustive(views: int) -> list[Pair]:
    """Return all pairs."""
    return list(combinations(range(views), 2))


def sequential(views: int) -> list[Pair]:
    """Return each view's next neighbours, and ever farther ones at distances of powers of two."""
    steps = sorted({*range(1, OVERLAP + 1), *(2**k for k in range(views.bit_length()))})
    return [(i, i + d) for i in range(views) for d in steps if i + d < views]


def similarities(descriptors: Sequence[NDArray[np.uint8]], threads: int = 1) -> NDArray[np.int64]:
    """Return how many matches views have with each other [V, V], without a vocabulary.

    Only the largest-scale features are compared, so that all pairs of hundreds of views cost
    seconds.
    """
    small = [d[:PREVIEW_FEATURES] for d in descriptors]  # sorted by scale
    out = np.zeros((len(small), len(small)), dtype=np.int64)
    compared = exhaustive(len(small))
    with ThreadPoolExecutor(threads) as pool:
        counts = pool.map(lambda pair: len(match(small[pair[0]], small[pair[1]])), compared)
        for (i, j), matches in zip(compared, counts, strict=True):
            out[i, j] = out[j, i] = matches
    return out


def most_similar(similar: NDArray[np.int64], count: int) -> list[Pair]:
    """Return each view's pairs with the ``count`` views most similar to it.

    This is also how a sequence's loop is closed.
    """
    pairs = set()
    for i, row in enumerate(similar):
        best = np.argsort(-row, kind="stable")[:count]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in best if row[j] > 0}
    return sorted(pairs)


def in_sequence(similar: NDArray[np.int64]) -> bool:
    """Whether nearly all views are followed by one of those most similar to them.

    A walk's photos and a video's frames are; photos of many people, sorted by name, are not.
    """
    chosen = set(most_similar(similar, SIMILAR_ALONE))
    followed = sum((i, i + 1) in chosen for i in range(len(similar) - 1))
    return followed >= FOLLOWED * (len(similar) - 1)


def facing(cameras: Mapping[int, Camera]) -> list[Pair]:
    """Return the pairs of posed views whose lines of sight are within 75 degrees."""
    least = np.cos(np.radians(WIDEST_ANGLE))
    sight = {number: camera.rotation[2] for number, camera in cameras.items()}
    pairs = combinations(sorted(sight), 2)
    return [(i, j) for i, j in pairs if sight[i] @ sight[j] >= least]


def choose_pairs(
    descriptors: Sequence[NDArray[np.uint8]], config: SfmConfig, threads: int = 1
) -> list[Pair]:
    """Return the pairs of unposed views to compare, (i, j) with i < j, sorted.

    ``auto`` takes more than ``similar_limit`` views for a sequence where :func:`in_sequence`: a
    walk, or a video's frames. The same for any ``threads``.
    """
    views, matcher = len(descriptors), config.matcher
    if matcher == "exhaustive" or (matcher == "auto" and views <= config.exhaustive_limit):
        return exhaustive(views)
    similar = similarities(descriptors, threads)
    if matcher == "auto":
        ordered = views > config.similar_limit and in_sequence(similar)
        matcher = "sequential" if ordered else "similar"
    if matcher == "similar":
        return most_similar(similar, SIMILAR_ALONE)
    return sorted({*sequential(views), *most_similar(similar, SIMILAR_BESIDE)})


def match(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> Matches:
    """Match descriptors [N, 128] and [M, 128]; returns rows [K, 2], each row used at most once."""
    if min(len(first), len(second)) < 2:
        return np.zeros((0, 2), dtype=np.uint32)
    forward = nearest(first, second)
    rows = np.flatnonzero(forward >= 0)
    if not len(rows):
        return np.zeros((0, 2), dtype=np.uint32)
    # only the few columns that were chosen need their own nearest row
    backward = nearest(second[forward[rows]], first)
    rows = rows[backward == rows]
    return np.stack([rows, forward[rows]], axis=1).astype(np.uint32)


def nearest(rows: NDArray[np.uint8], columns: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the nearest of ``columns`` [M, 128] for each of ``rows`` [N, 128].

    -1 where the nearest is too far, or the second nearest almost as near.
    """
    column, best, second = (np.empty(len(rows), dtype=np.int32) for _ in range(3))
    _descriptors.nearest(rows, columns, column, best, second)
    return np.where(passes_ratio_test(best, second), column, -1).astype(np.int64)


def passes_ratio_test(best: NDArray[Any], second: NDArray[Any]) -> NDArray[np.bool_]:
    """Say whether the best product is near enough, and so much nearer than the second best."""
    unit = np.float32(DESCRIPTOR_LENGTH**2)
    best, second = best.astype(np.float32), second.astype(np.float32)
    near = np.arccos(np.clip(best / unit, -1, 1))
    next_near = np.arccos(np.clip(second / unit, -1, 1))
    return np.asarray((near <= FARTHEST) & (near < RATIO * next_near))


def match_and_verify(
    pairs: Sequence[Pair],
    descriptors: Sequence[NDArray[np.uint8]],
    rows: Sequence[NDArray[np.int64]],
    positions: Sequence[NDArray[np.float64]],
    inside: Sequence[NDArray[np.bool_]],
    cameras: Sequence[Any],
    seed: int,
    threads: int,
    progress: Callable[[int, int, str], None],
) -> dict[Pair, Verified]:
    """Match pairs and keep what one epipolar geometry explains; the same for any ``threads``.

    Per view, ``descriptors`` [S, 128] belong to the key points ``rows`` [S] of all its key points
    ``positions`` [K, 2] (pixels), which lie on the object or not (``inside`` [K]); matches are
    numbered among all. ``cameras`` are pycolmap's. Pairs with fewer than 15 inliers are left out;
    where nothing matches, all are.
    """
    import pycolmap

    def verified(pair: Pair, matches: Matches) -> Verified:
        i, j = pair
        options = _options(len(matches), seed)
        geometry = pycolmap.estimate_two_view_geometry(
            cameras[i], positions[i], cameras[j], positions[j], matches, options
        )
        inliers = np.asarray(geometry.inlier_matches, dtype=np.uint32).reshape(-1, 2)
        return Verified(geometry, inliers)

    def one(pair: Pair) -> Verified | None:
        i, j = pair
        matches = match(descriptors[i], descriptors[j])
        if len(matches) < LEAST_MATCHES:
            return None
        matches = numbered(matches, rows[i], rows[j])
        found = verified(pair, matches)
        if len(found.matches) < LEAST_MATCHES:
            return None
        sides = inside[i], inside[j]
        its = object_matches(matches, found.matches, sides, lambda m: verified(pair, m).matches)
        outside = (~side[m] for side, m in zip(sides, found.matches.T, strict=True))
        return replace(found, on_object=its, beside=int(np.logical_and(*outside).sum()))

    out: dict[Pair, Verified] = {}
    with ThreadPoolExecutor(threads) as pool:
        for done, (pair, found) in enumerate(
            zip(pairs, pool.map(one, pairs), strict=True), start=1
        ):
            if found is not None:
                out[pair] = found
            progress(done, len(pairs), f"{len(out)} of {done} pairs match")
    return out


def numbered(matches: Matches, first: NDArray[np.int64], second: NDArray[np.int64]) -> Matches:
    """Turn matches [M, 2] between subsets into matches between all key points of both views."""
    return np.stack([first[matches[:, 0]], second[matches[:, 1]]], axis=1).astype(np.uint32)


def partners(pairs: Mapping[Pair, int], names: Sequence[str]) -> dict[str, list[tuple[str, int]]]:
    """Return each view's partners, best first, from the inliers of verified pairs (i, j)."""
    out: dict[str, list[tuple[str, int]]] = {}
    for (i, j), count in pairs.items():
        out.setdefault(names[i], []).append((names[j], count))
        out.setdefault(names[j], []).append((names[i], count))
    return {
        name: sorted(others, key=lambda pair: (-pair[1], pair[0])) for name, others in out.items()
    }


def _options(matches: int, seed: int) -> Any:
    """Return RANSAC's options for a pair with ``matches`` matches.

    A pair is kept for ``LEAST_MATCHES`` inliers, so RANSAC may stop when models with as many are
    unlikely. Most of its time went into pairs without such a model. COLMAP's own bound holds where
    it is higher.
    """
    import pycolmap

    options = pycolmap.TwoViewGeometryOptions()
    options.min_num_inliers = LEAST_MATCHES
    options.ransac.random_seed = seed
    options.ransac.num_threads = 1
    needed = LEAST_MATCHES / matches
    options.ransac.min_inlier_ratio = max(options.ransac.min_inlier_ratio, needed)
    return options


def merged(first: Mapping[Pair, Matches], second: Mapping[Pair, Matches]) -> dict[Pair, Matches]:
    """Add the matches of ``second`` whose key points ``first`` does not match in that pair."""
    out = dict(first)
    for pair, extra in second.items():
        old = out.get(pair, np.zeros((0, 2), dtype=np.uint32))
        new = ~np.isin(extra[:, 0], old[:, 0]) & ~np.isin(extra[:, 1], old[:, 1])
        out[pair] = np.concatenate([old, extra[new]])
    return out
