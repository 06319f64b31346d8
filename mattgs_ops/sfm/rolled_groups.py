"""Groups of photos that only the object ties to the others, and that lie on their side by that.

A logo that is printed on two sides of a box, on one of them turned by a quarter, ties all photos of
one side to those of the other. What stands beside the object cannot contradict where no photo of
the one group shares it with the other. But people hold cameras upright: the right-hand axes of all
photos are level, wherever they look, up and down included. Where those of one group stand upright
in the poses of the others, the ties between them are false. Plain geometry; COLMAP is not needed.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.sfm.colmap.features import Pair
from mattgs_ops.sfm.colmap.matching import LEAST_MATCHES, Verified
from mattgs_ops.sfm.given_poses import FEWEST_PAIRS
from mattgs_ops.sfm.lost_views import MOST_VIEWS

# Between a photo that is held upright and one that is held on its side, by a quarter of a turn
ON_ITS_SIDE = np.sin(np.radians(45))
# Level axes that turn by less tell a plane, and so the vertical, too badly
LEAST_ARC = np.radians(30)
# One or two photos are often taken with the camera turned
FEWEST_VIEWS = 3


def groups_of(pairs: Mapping[Pair, Verified]) -> list[set[int]]:
    """Return the groups of views that matches beside the object tie, the largest first.

    COLMAP keeps a pair for :data:`LEAST_MATCHES`, and fewer than :data:`FEWEST_PAIRS` such pairs
    may match falsely. So as many matches as these have must tie two views of a group, over one pair
    or several. Views that share fewer than one such pair with any other are in no group.
    """
    ties = {pair: count for pair, one in pairs.items() if (count := one.beside // LEAST_MATCHES)}
    groups = [{view} for view in sorted({view for pair in ties for view in pair})]
    while groups:
        number = {view: k for k, group in enumerate(groups) for view in group}
        between = np.zeros((len(groups), len(groups)), dtype=np.int64)
        for (first, second), count in ties.items():
            between[number[first], number[second]] += count
        between += between.T
        np.fill_diagonal(between, 0)
        # straight ways, and those by way of one other group
        ways = between + np.stack([np.minimum(row, between).sum(axis=1) for row in between])
        np.fill_diagonal(ways, 0)
        if ways.max() < FEWEST_PAIRS:
            break
        groups = _joined(groups, np.argwhere(ways >= FEWEST_PAIRS).tolist())
    return sorted(groups, key=lambda group: (-len(group), min(group)))


def _joined(groups: Sequence[set[int]], pairs: Sequence[Sequence[int]]) -> list[set[int]]:
    """Join the groups of each pair of numbers; what is joined twice is one.

    SciPy could, but pycolmap quarrels with libraries beside it: its process loads as few as it can.
    """
    root = list(range(len(groups)))

    def found(k: int) -> int:
        while root[k] != k:
            k = root[k]
        return k

    for first, second in pairs:
        root[found(first)] = found(second)
    out: dict[int, set[int]] = {}
    for k, group in enumerate(groups):
        out.setdefault(found(k), set()).update(group)
    return list(out.values())


def vertical(cameras: Collection[Camera]) -> NDArray[np.float64] | None:
    """Return the direction [3], of length 1, to which the cameras' right-hand axes are square.

    It is the eigenvector of the least eigenvalue of the axes' second moments. None where they span
    less than :data:`LEAST_ARC`, where more than one in twenty is not level, or where most cameras'
    own verticals lie across it: then some are held upright and others on their side.
    """
    right = np.stack([camera.rotation[0] for camera in cameras])
    values, vectors = np.linalg.eigh(right.T @ right / len(right))
    # axes that are spread evenly over an arc A have the variance A² / 12 along it
    if values[1] < LEAST_ARC**2 / 12:
        return None
    up: NDArray[np.float64] = vectors[:, 0]
    level = np.abs(right @ up) < ON_ITS_SIDE
    upright = np.abs([camera.rotation[1] @ up for camera in cameras]) > ON_ITS_SIDE
    return up if level.mean() >= MOST_VIEWS and upright.mean() > 0.5 else None


def on_their_side(
    cameras: Mapping[int, Camera], groups: Sequence[Collection[int]]
) -> list[set[int]]:
    """Return the groups all of whose placed views lie on their side in the first one's poses.

    The first is that of most placed views. Groups of fewer than :data:`FEWEST_VIEWS` count only
    beside one of as many. ``cameras`` are the placed views' by their places.
    """
    placed = [(group, [view for view in group if view in cameras]) for group in groups]
    placed = [(group, views) for group, views in placed if views]
    if not placed:
        return []
    first = max((views for _, views in placed), key=len)
    up = vertical([cameras[view] for view in first])
    if up is None:
        return []
    lying = [
        (group, views)
        for group, views in placed
        if all(abs(cameras[view].rotation[0] @ up) > ON_ITS_SIDE for view in views)
    ]
    if all(len(views) < FEWEST_VIEWS for _, views in lying):
        return []
    return [set(group) for group, _ in lying]


def without_ties(
    pairs: Mapping[Pair, Verified], groups: Sequence[Collection[int]]
) -> dict[Pair, Verified]:
    """Return the pairs both views of which are in the same one of the groups, or in none."""

    def place(view: int) -> int:
        return next((k for k, group in enumerate(groups) if view in group), -1)

    return {pair: one for pair, one in pairs.items() if place(pair[0]) == place(pair[1])}
