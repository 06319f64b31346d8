"""Matches along epipolar lines, for views whose poses are known.

Where poses are fixed, a key point's partner can only lie near a line (Hartley & Zisserman 2004,
chapter 9). Lowe's ratio test then asks whether the best partner stands out *near that line*, which
repeated and small structures pass that fail it over a whole photo. Worker process only.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.sfm.colmap.matching import Matches, Pair, nearest

Array = NDArray[np.float64]
BAND = 2.0  # pixels beside the line; COLMAP calls twice as much an inlier
OUT_OF_BAND = -1.0  # below every product of descriptors


def essential(first: Camera, second: Camera) -> Array:
    """Return E [3, 3] with ``x2ᵀ E x1 = 0`` for one point's rays in two views."""
    rotation = second.rotation @ first.rotation.T
    x, y, z = second.translation - rotation @ first.translation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(cross @ rotation, dtype=np.float64)


def line_distances(matrix: Array, first: Array, second: Array) -> Array:
    """Return how far each of ``second`` [M, 2] is from the line of each of ``first`` [N, 2].

    Both are on the normalised image plane; the result [N, M] is in focal lengths.
    """
    lines = np.column_stack([first, np.ones(len(first))]) @ matrix.T
    length = np.maximum(np.hypot(lines[:, 0], lines[:, 1]), 1e-12)[:, None]
    points = np.column_stack([second, np.ones(len(second))])
    return np.asarray(np.abs(lines @ points.T) / length, dtype=np.float64)


def match_near_lines(
    first: NDArray[np.uint8], second: NDArray[np.uint8], near: NDArray[np.bool_]
) -> Matches:
    """Match descriptors [N, 128] and [M, 128] where ``near`` [N, M] allows; see ``match``."""
    if min(len(first), len(second)) < 2:
        return np.zeros((0, 2), dtype=np.uint32)
    products = first.astype(np.float32) @ second.astype(np.float32).T
    products[~near] = OUT_OF_BAND
    turned = np.ascontiguousarray(products.T)
    there, back = nearest(products), nearest(turned)
    rows = np.flatnonzero(there >= 0)
    rows = rows[back[there[rows]] == rows]
    return np.stack([rows, there[rows]], axis=1).astype(np.uint32)


def match_guided(
    pairs: Sequence[Pair],
    descriptors: Sequence[NDArray[np.uint8]],
    rows: Sequence[NDArray[np.int64]],
    rays: Mapping[int, Array],
    cameras: Mapping[int, Camera],
    threads: int,
    tell: Callable[[int, int, str], None],
) -> dict[Pair, Matches]:
    """Match pairs of posed views; the same for any ``threads``.

    Per view, ``descriptors`` [S, 128] and ``rays`` [S, 2] (normalised image plane, without
    distortion) belong to the key points ``rows`` [S] of all its key points; matches are numbered
    among all. Pairs without matches are left out.
    """

    def one(pair: Pair) -> Matches:
        i, j = pair
        matrix = essential(cameras[i], cameras[j])
        bands = [BAND / min(c.intrinsics.fx, c.intrinsics.fy) for c in (cameras[j], cameras[i])]
        there = line_distances(matrix, rays[i], rays[j]) <= bands[0]
        back = line_distances(matrix.T, rays[j], rays[i]) <= bands[1]
        found = match_near_lines(descriptors[i], descriptors[j], there & back.T)
        return np.stack([rows[i][found[:, 0]], rows[j][found[:, 1]]], axis=1).astype(np.uint32)

    out: dict[Pair, Matches] = {}
    total = 0
    with ThreadPoolExecutor(threads) as pool:
        for done, (pair, matches) in enumerate(
            zip(pairs, pool.map(one, pairs), strict=True), start=1
        ):
            if len(matches):
                out[pair] = matches
            total += len(matches)
            tell(done, len(pairs), f"{total} matches in {done} pairs along epipolar lines")
    return out
