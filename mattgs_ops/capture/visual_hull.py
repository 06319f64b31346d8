"""Random points in the masks' visual hull, for where too few points could be triangulated.

3DGS starts from random points where there is no sparse model (Kerbl et al. 2023, section 7); the
masks confine them to where the object can be (Laurentini 1994).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, in_frame
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
PARALLEL = 1e-6  # mean square of the sine between axes: a twentieth of a degree
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
    posed, cameras, masks = _carving(views)
    rng = np.random.default_rng(seed)
    xyz = sample(cameras, masks, count, rng) if cameras else np.zeros((0, 3))
    if not len(xyz):
        raise StageError(
            "random points: masks and camera poses have no common volume; expected poses under "
            "which all masks show one object. Where cameras came with the capture, they are not "
            "those of its photos, or in other axes: a COLMAP model is world-to-camera, "
            "`transform_matrix` must be camera-to-world, in OpenGL's axes (x right, y up, z "
            'back). Mend them, or have poses estimated (sfm.poses = "estimate")'
        )
    rgb, seen = _colours(xyz, posed)
    return SparsePoints(xyz, rgb, np.ones(len(xyz), dtype=np.float32), seen)


def with_random(points: SparsePoints, before: SparsePoints, views: Sequence[View]) -> SparsePoints:
    """Add the random points that ``before`` has after those of its model, which ``points`` are.

    Masks have changed since: only those in today's visual hull are kept, or all where none is.
    """
    random = before.chosen(slice(len(points.xyz), None))
    if not len(random.xyz):
        return points
    _, cameras, masks = _carving(views)
    kept = _in_hull(random.xyz, cameras, masks)
    if cameras and kept.any():
        random = random.chosen(kept)
    return joined(points, random)


def _carving(views: Sequence[View]) -> tuple[list[View], list[Camera], list[Mask]]:
    """Return the training views that show an object, with their cameras and masks.

    A view in which nothing was found is dropped: it carves nothing away.
    """
    posed, cameras, masks = [], [], []
    for view in views:
        if view.split != "train" or view.camera is None or view.mask is None:
            continue
        mask = read_map(view.mask)
        if mask.any():
            posed.append(view)
            cameras.append(view.camera)
            masks.append(mask)
    return posed, cameras, masks


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
    """Return the point [3] with the least squared distance to all optical axes.

    Cameras that all look the same way have no such point. Then it is the one before the middle of
    them that is as far away as they are apart, wherever the world's origin lies.
    """
    axes = np.array([camera.rotation[2] for camera in cameras])  # z forward, world coordinates
    centres = np.array([camera.centre for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # projects onto the axis' normal plane
    total = across.sum(axis=0)
    middle = centres.mean(axis=0)
    if np.linalg.eigvalsh(total)[0] < PARALLEL * len(cameras):
        spread = float(np.linalg.norm(centres - middle, axis=1).max())
        ahead: Array = middle + axes.mean(axis=0) * 2 * spread
        return ahead
    right = (across @ centres[:, :, None]).sum(axis=0)[:, 0]
    solution: Array = np.linalg.lstsq(total, right, rcond=None)[0]
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
        framed += in_frame(pixels, depths, (lens.width, lens.height))
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
