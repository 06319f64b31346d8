"""Random points inside the masks' visual hull, for objects on which nothing can be triangulated.

3DGS starts from random points where there is no sparse model (Kerbl et al. 2023, section 7); the
masks confine them to where the object can be (Laurentini 1994).
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.scene import SparsePoints, View
from mattgs_ops.capture.sparse import inside
from mattgs_ops.errors import StageError

Array = NDArray[np.float64]
# Of the views that have a point in their frame, this share must place it in the mask; masks are
# never perfect, and one bad one must not carve the object away.
AGREEMENT = 0.9
ROUNDS = 200  # of ``count`` candidates each; enough for a hull of half a percent of the volume


def fill(views: Sequence[View], count: int, seed: int) -> SparsePoints:
    """Return ``count`` points uniform in the visual hull, coloured as the training photos see them.

    Raises :class:`StageError` when masks and cameras agree on no volume.
    """
    posed = [v for v in views if v.camera is not None and v.mask is not None]
    cameras = [v.camera for v in posed if v.camera is not None]
    masks = [_read(str(v.mask), cv2.IMREAD_GRAYSCALE) for v in posed]
    centre, radius = look_at_volume(cameras)
    rng = np.random.default_rng(seed)
    kept: list[Array] = []
    for _ in range(ROUNDS):
        points = centre + radius * rng.uniform(-1, 1, (count, 3))
        kept.append(points[_agreed(points, cameras, masks)])
        if sum(map(len, kept)) >= count:
            break
    xyz = np.concatenate(kept)[:count]
    if not len(xyz):
        raise StageError(
            "random points: masks and camera poses have no common volume; expected poses under "
            "which all masks show one object"
        )
    rgb, seen = _colours(xyz, posed)
    return SparsePoints(xyz, rgb, np.ones(len(xyz), dtype=np.float32), seen)


def look_at_volume(cameras: Sequence[Camera]) -> tuple[Array, float]:
    """Return the point nearest to all lines of sight, and the radius that every view holds.

    The radius is the largest of a ball about that point that fits every view's cone, at least a
    tenth of the mean distance.
    """
    sights = np.array([c.rotation[2] for c in cameras])
    centres = np.array([c.centre for c in cameras])
    across = np.eye(3) - sights[:, :, None] * sights[:, None, :]  # projections off each line
    target = np.linalg.lstsq(across.sum(0), (across @ centres[:, :, None]).sum(0), rcond=None)
    centre = target[0][:, 0]
    distances = np.linalg.norm(centres - centre, axis=1)
    slopes = [
        max(c.intrinsics.width / c.intrinsics.fx, c.intrinsics.height / c.intrinsics.fy) / 2
        for c in cameras
    ]
    cones = distances * np.sin(np.arctan(slopes))
    return centre, float(max(cones.min(), 0.1 * distances.mean()))


def joined(first: SparsePoints, second: SparsePoints) -> SparsePoints:
    """Return the points of both."""
    return SparsePoints(
        np.concatenate([first.xyz, second.xyz]),
        np.concatenate([first.rgb, second.rgb]),
        np.concatenate([first.object_share, second.object_share]),
        np.concatenate([first.views_seen, second.views_seen]),
    )


def _agreed(
    points: Array, cameras: Sequence[Camera], masks: Sequence[NDArray[np.uint8]]
) -> NDArray[np.bool_]:
    framed, votes = np.zeros(len(points)), np.zeros(len(points))
    for camera, mask in zip(cameras, masks, strict=True):
        pixels, depths = camera.project(points)
        framed += inside(np.full_like(mask, 255), pixels, depths)
        votes += inside(mask, pixels, depths)
    return (framed >= len(cameras) / 2) & (votes >= AGREEMENT * framed)


def _colours(xyz: Array, views: Sequence[View]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Average the training photos' colours over the views whose mask holds the point.

    Test photos have no say: what a training starts from must not know them.
    """
    total, hits = np.zeros((len(xyz), 3)), np.zeros(len(xyz), dtype=np.int32)
    for view in views:
        if view.split != "train" or view.camera is None:
            continue
        pixels, depths = view.camera.project(xyz)
        hit = inside(_read(str(view.mask), cv2.IMREAD_GRAYSCALE), pixels, depths)
        cells = np.floor(pixels[hit]).astype(np.int64)
        photo = _read(str(view.photo), cv2.IMREAD_COLOR)[..., ::-1]
        total[hit] += photo[cells[:, 1], cells[:, 0]]
        hits += hit
    return np.rint(total / np.maximum(hits, 1)[:, None]).astype(np.uint8), hits


def _read(path: str, how: int) -> NDArray[np.uint8]:
    image = cv2.imread(path, how)
    if image is None:
        raise StageError(f"{path}: expected a readable image")
    return np.asarray(image, dtype=np.uint8)
