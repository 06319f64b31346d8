"""Random points in the masks' visual hull, for where too few points could be triangulated.

3DGS starts from random points where there is no sparse model (Kerbl et al. 2023, section 7); the
masks confine them to where the object can be (Laurentini 1994).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import Mask, read_map
from mattgs_ops.capture.photos import read_rgb
from mattgs_ops.capture.scene import SparsePoints, View
from mattgs_ops.capture.sparse import inside
from mattgs_ops.errors import StageError

Array = NDArray[np.float64]
SEEN_SHARE = 0.5  # of the cameras must have a point in their frame
# Of the views that have a point in their frame, this share must place it in the mask; masks are
# never perfect, and one bad one must not carve the object away.
HULL_SHARE = 0.9
ROUNDS = 200  # of ``count`` candidates each; enough for a hull of half a percent of the volume


def sample(
    cameras: Sequence[Camera], masks: Sequence[Mask] | None, count: int, rng: np.random.Generator
) -> Array:
    """Return at most ``count`` points [P, 3], uniform in the volume that the cameras share.

    With ``masks`` ([H, W] of each camera's size, object where not 0) only points of their visual
    hull. Fewer points, or none, come back where the volume is nearly or wholly empty.
    """
    centre, half = shared_cube(cameras)
    found: list[Array] = []
    for _ in range(ROUNDS):
        points = centre + rng.uniform(-half, half, (count, 3))
        found.append(points[_in_hull(points, cameras, masks)])
        if sum(map(len, found)) >= count:
            break
    return np.concatenate(found)[:count]


def fill(views: Sequence[View], count: int, seed: int) -> SparsePoints:
    """Return at most ``count`` points of the training views' visual hull, coloured as they see it.

    Held-out views have no say: what a training starts from must not know them. Raises
    :class:`StageError` when masks and cameras agree on no volume.
    """
    trained = [view for view in views if view.split == "train"]
    posed = [v for v in trained if v.camera is not None and v.mask is not None]
    cameras = [v.camera for v in posed if v.camera is not None]
    masks = [read_map(v.mask) for v in posed if v.mask is not None]
    xyz = sample(cameras, masks, count, np.random.default_rng(seed))
    if not len(xyz):
        raise StageError(
            "random points: masks and camera poses have no common volume; expected poses under "
            "which all masks show one object"
        )
    rgb, seen = _colours(xyz, posed)
    return SparsePoints(xyz, rgb, np.ones(len(xyz), dtype=np.float32), seen)


def shared_cube(cameras: Sequence[Camera]) -> tuple[Array, float]:
    """Return middle [3] and half the side of the cube, in world units, that the cameras look at.

    The middle is the point nearest to all optical axes; half the side is half the width of the
    frame there (medians over the cameras): an object that fills more is not seen in full.
    """
    middle = nearest_to_axes(cameras)
    distance = float(np.median([np.linalg.norm(c.centre - middle) for c in cameras]))
    lenses = [camera.intrinsics for camera in cameras]
    field = float(np.median([max(i.width / i.fx, i.height / i.fy) for i in lenses]))
    return middle, distance * field / 2


def nearest_to_axes(cameras: Sequence[Camera]) -> Array:
    """Return the point [3] with the least squared distance to all optical axes."""
    axes = np.array([camera.rotation[2] for camera in cameras])  # z forward, world coordinates
    centres = np.array([camera.centre for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # projects onto the axis' normal plane
    right = (across @ centres[:, :, None]).sum(axis=0)[:, 0]
    solution: Array = np.linalg.lstsq(across.sum(axis=0), right, rcond=None)[0]
    return solution


def joined(first: SparsePoints, second: SparsePoints) -> SparsePoints:
    """Return the points of both."""
    return SparsePoints(
        np.concatenate([first.xyz, second.xyz]),
        np.concatenate([first.rgb, second.rgb]),
        np.concatenate([first.object_share, second.object_share]),
        np.concatenate([first.views_seen, second.views_seen]),
    )


def _in_hull(
    points: Array, cameras: Sequence[Camera], masks: Sequence[Mask] | None
) -> NDArray[np.bool_]:
    framed, votes = np.zeros(len(points)), np.zeros(len(points))
    for index, camera in enumerate(cameras):
        pixels, depths = camera.project(points)
        lens = camera.intrinsics
        framed += inside(np.ones((lens.height, lens.width), dtype=np.uint8), pixels, depths)
        if masks is not None:
            votes += inside(masks[index], pixels, depths)
    shared = framed >= max(1.0, SEEN_SHARE * len(cameras))
    return shared if masks is None else shared & (votes >= HULL_SHARE * framed)


def _colours(xyz: Array, views: Sequence[View]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Average the photos' colours over the views whose mask holds the point."""
    total, hits = np.zeros((len(xyz), 3)), np.zeros(len(xyz), dtype=np.int32)
    for view in views:
        if view.camera is None or view.mask is None:
            continue
        pixels, depths = view.camera.project(xyz)
        hit = inside(read_map(view.mask), pixels, depths)
        cells = np.floor(pixels[hit]).astype(np.int64)
        photo = read_rgb(view.photo)
        total[hit] += photo[cells[:, 1], cells[:, 0]]
        hits += hit
    return np.rint(total / np.maximum(hits, 1)[:, None]).astype(np.uint8), hits
