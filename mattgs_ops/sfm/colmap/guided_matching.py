"""Matches along epipolar lines, for views with known poses.

Where poses are fixed, a key point's partner can only lie near a line (Hartley & Zisserman 2004,
chapter 9). Lowe's ratio test compares the best partner with others *near that line* only. Repeated
and small structures pass it there, and fail it over the whole photo. Worker process only.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.sfm.colmap.matching import Matches, Pair, numbered, passes_ratio_test

Array = NDArray[np.float64]
BAND = 2.0  # pixels beside the line; COLMAP calls twice as much an inlier
OUT_OF_BAND = -1.0  # below every product of descriptors
BLOCK = 128  # rows at a time: what belongs to them stays in the processor's cache


def essential(first: Camera, second: Camera) -> Array:
    """Return E [3, 3] with ``x2ᵀ E x1 = 0`` for one point's rays in two views."""
    rotation = second.rotation @ first.rotation.T
    x, y, z = second.translation - rotation @ first.translation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(cross @ rotation, dtype=np.float64)


def epipolar_lines(matrix: Array, points: Array) -> Array:
    """Return the lines [N, 3] of points [N, 2] in the other view; ``line · (x, y, 1)`` is metric.

    Points and lines are on the normalised image plane: distances are in focal lengths.
    """
    lines = homogeneous(points) @ matrix.T
    lines /= np.maximum(np.hypot(lines[:, 0], lines[:, 1]), 1e-12)[:, None]
    return np.asarray(lines, dtype=np.float64)


def homogeneous(points: Array) -> Array:
    """Return points [N, 2] as (x, y, 1)."""
    return np.column_stack([points, np.ones(len(points))])


def near_lines(
    matrix: Array, first: Array, second: Array, bands: tuple[float, float]
) -> Callable[[slice], NDArray[np.bool_]]:
    """Return a function that says, for some of ``first`` [N, 2], which of ``second`` are near.

    Near means within ``bands`` (focal lengths) of each other's line, in the second view and in the
    first. Single precision will do: bands are a thousandth of a focal length.
    """
    there = epipolar_lines(matrix, first).astype(np.float32)
    back = epipolar_lines(matrix.T, second).astype(np.float32).T
    mine, yours = homogeneous(first).astype(np.float32), homogeneous(second).astype(np.float32).T

    def near(part: slice) -> NDArray[np.bool_]:
        close = np.abs(there[part] @ yours) <= np.float32(bands[0])
        close &= np.abs(mine[part] @ back) <= np.float32(bands[1])
        return np.asarray(close)

    return near


def match_near_lines(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    near: Callable[[slice], NDArray[np.bool_]],
) -> Matches:
    """Match descriptors [N, 128] and [M, 128] where ``near`` allows; see ``match``.

    ``near`` says for some rows of the first which of the second may match them.
    """
    if min(len(first), len(second)) < 2:
        return np.zeros((0, 2), dtype=np.uint32)
    a, b = first.astype(np.float32), second.astype(np.float32).T
    parts = []
    for start in range(0, len(a), BLOCK):
        part = slice(start, start + BLOCK)
        row, column = np.nonzero(near(part))
        parts.append((row + start, column, (a[part] @ b)[row, column]))
    row, column, product = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    there = nearest_of(row, column, product, len(first))
    back = nearest_of(column, row, product, len(second))
    rows = np.flatnonzero(there >= 0)
    rows = rows[back[there[rows]] == rows]
    return np.stack([rows, there[rows]], axis=1).astype(np.uint32)


def nearest_of(
    row: NDArray[np.int64], column: NDArray[np.int64], product: NDArray[np.float32], count: int
) -> NDArray[np.int64]:
    """Return for ``count`` rows what ``matching.nearest`` does, from some products [P] alone."""
    order = np.lexsort((column, -product, row))
    row, column, product = row[order], column[order], product[order]
    best = np.flatnonzero(np.diff(row, prepend=-1))
    follows = np.minimum(best + 1, len(row) - 1)
    alone = (follows == best) | (row[follows] != row[best])
    second = np.where(alone, OUT_OF_BAND, product[follows])
    out = np.full(count, -1, dtype=np.int64)
    out[row[best]] = np.where(passes_ratio_test(product[best], second), column[best], -1)
    return out


def match_guided(
    pairs: Sequence[Pair],
    descriptors: Sequence[NDArray[np.uint8]],
    rows: Sequence[NDArray[np.int64]],
    rays: Mapping[int, Array],
    cameras: Mapping[int, Camera],
    threads: int,
    progress: Callable[[int, int, str], None],
) -> dict[Pair, Matches]:
    """Match pairs of posed views; the same for any ``threads``.

    Per view, ``descriptors`` [S, 128] and ``rays`` [S, 2] (normalised image plane, without
    distortion) belong to the key points ``rows`` [S] of all its key points; matches are numbered
    among all. Pairs without matches are left out.
    """

    def one(pair: Pair) -> Matches:
        i, j = pair
        matrix = essential(cameras[i], cameras[j])
        across, here = (
            BAND / min(c.intrinsics.fx, c.intrinsics.fy) for c in (cameras[j], cameras[i])
        )
        near = near_lines(matrix, rays[i], rays[j], (across, here))
        return numbered(match_near_lines(descriptors[i], descriptors[j], near), rows[i], rows[j])

    out: dict[Pair, Matches] = {}
    total = 0
    with ThreadPoolExecutor(threads) as pool:
        for done, (pair, matches) in enumerate(
            zip(pairs, pool.map(one, pairs), strict=True), start=1
        ):
            if len(matches):
                out[pair] = matches
            total += len(matches)
            progress(done, len(pairs), f"{total} matches in {done} pairs along epipolar lines")
    return out
