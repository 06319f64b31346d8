"""Matches along epipolar lines, for views with known poses.

Where poses are fixed, a key point's partner can only lie near a line (Hartley & Zisserman 2004,
chapter 9). Lowe's ratio test compares the best partner with others *near that line* only. Repeated
and small structures pass it there, and fail it over the whole photo. Worker process only.
"""

import time
from collections.abc import Callable, Mapping, Sequence, Set
from concurrent.futures import Executor, Future
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.sfm.colmap.features import Matches, Pair
from mattgs_ops.sfm.colmap.matching import facing, numbered, passes_ratio_test

Array = NDArray[np.float64]
Job = Callable[[], tuple[Matches, float]]  # matches a pair; see ``match_pair``
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


def match_pair(
    pair: Pair,
    descriptors: Sequence[NDArray[np.uint8]],
    rows: Sequence[NDArray[np.int64]],
    rays: Mapping[int, Array],
    cameras: Mapping[int, Camera],
) -> tuple[Matches, float]:
    """Match two posed views; returns the matches and the processor seconds they took.

    Per view, ``descriptors`` [S, 128] and ``rays`` [S, 2] (normalised image plane, without
    distortion) belong to the key points ``rows`` [S] of all its key points; matches are numbered
    among all.
    """
    began = time.thread_time()
    i, j = pair
    matrix = essential(cameras[i], cameras[j])
    across, here = (BAND / min(c.intrinsics.fx, c.intrinsics.fy) for c in (cameras[j], cameras[i]))
    near = near_lines(matrix, rays[i], rays[j], (across, here))
    found = numbered(match_near_lines(descriptors[i], descriptors[j], near), rows[i], rows[j])
    return found, time.thread_time() - began


class Guide:
    """Matches pairs of views as soon as their poses are known, beside whatever its caller does.

    ``see`` takes the poses of a model that still grows: the views that were in it at the last call
    too have been adjusted together since, and their pairs are matched with the poses of that
    moment. ``settle`` takes the poses at the end, for all pairs that are left. ``finish`` returns
    the matches. ``helpers`` match from the first call on, and the caller's own thread joins them in
    ``finish``. Which poses a pair is matched with does not depend on them, nor do the matches.
    """

    def __init__(
        self,
        descriptors: Sequence[NDArray[np.uint8]],
        rows: Sequence[NDArray[np.int64]],
        helpers: Executor | None = None,
    ) -> None:
        """See ``match_pair`` for ``descriptors`` and ``rows`` of all views."""
        self.descriptors, self.rows = descriptors, rows
        self._spent = 0.0
        self._helpers = helpers
        self._jobs: dict[Pair, Job] = {}
        self._begun: dict[Pair, Future[tuple[Matches, float]]] = {}
        self._seen: set[int] = set()

    def see(self, cameras: Mapping[int, Camera], rays: Mapping[int, Array]) -> None:
        """Take the poses of a growing model; one without views of the last is another model."""
        if not self._seen <= cameras.keys():
            self._keep(set())
            self._seen = set()
        self._add(self._seen & cameras.keys(), cameras, rays)
        self._seen = set(cameras)

    def settle(
        self, cameras: Mapping[int, Camera], rays: Mapping[int, Array], *, same: bool = True
    ) -> None:
        """Take the last poses; ``same``: of the model whose earlier poses were seen."""
        self._keep(set(cameras) if same else set())
        self._add(set(cameras), cameras, rays)

    def finish(self, progress: Callable[[int, int, str], None]) -> dict[Pair, Matches]:
        """Return the matches of all pairs that have some, sorted by pair."""
        done: dict[Pair, tuple[Matches, float]] = {}
        total = 0

        def add(pair: Pair, result: tuple[Matches, float]) -> None:
            nonlocal total
            done[pair] = result
            total += len(result[0])
            note = f"{total} matches in {len(done)} pairs along epipolar lines"
            progress(len(done), len(self._jobs), note)

        for pair in reversed(self._jobs):  # helpers come from the front
            begun = self._begun.get(pair)
            if begun is None or begun.cancel():
                add(pair, self._jobs[pair]())
        for pair in [pair for pair in self._jobs if pair not in done]:
            add(pair, self._begun[pair].result())
        self._spent = sum(seconds for _, seconds in done.values())
        return {pair: done[pair][0] for pair in sorted(done) if len(done[pair][0])}

    @property
    def pairs(self) -> int:
        """How many pairs are matched or to be matched."""
        return len(self._jobs)

    def spent(self) -> float:
        """Return the processor seconds of all matching, helpers' as well; 0 until it is done."""
        return self._spent

    def _add(
        self, views: Set[int], cameras: Mapping[int, Camera], rays: Mapping[int, Array]
    ) -> None:
        for pair in facing({view: cameras[view] for view in views}):
            if pair in self._jobs:
                continue
            job = partial(match_pair, pair, self.descriptors, self.rows, rays, cameras)
            self._jobs[pair] = job
            if self._helpers is not None:
                self._begun[pair] = self._helpers.submit(job)

    def _keep(self, views: Set[int]) -> None:
        """Forget the pairs of other views."""
        for pair in [pair for pair in self._jobs if not views >= set(pair)]:
            del self._jobs[pair]
            if pair in self._begun:
                self._begun.pop(pair).cancel()
