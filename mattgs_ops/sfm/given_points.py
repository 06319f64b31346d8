"""What came with a capture and is no longer to be found: cameras, and perhaps points."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Intrinsics
from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.scene import GivenPoints, PreparedCapture
from mattgs_ops.capture.sparse import NO_ERROR, SparseImage, SparseModel
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.checks import keeps_poses

# A training starts from no fewer; a cloud that is smaller was hardly meant to start from.
FEWEST_POINTS = 100


def given_model(capture: PreparedCapture, config: SfmConfig) -> SparseModel | None:
    """Return the model that came with a capture, None where something must be found.

    That is so for captures without cameras or points, with fewer than 100 points, and where the
    configuration asks for poses or points of our own. Images are called like the views' files; a
    point's key point is its projection. Points of a file without tracks have none.
    """
    kept = keeps_poses(capture, config) and config.points == "auto"
    points = capture.points if kept else None
    if points is None or len(points.xyz) < FEWEST_POINTS:
        return None
    numbers: dict[Intrinsics, int] = {}
    seen = _seen_by(points)
    images = {}
    for number, view in enumerate(capture.views, start=1):
        if view.camera is None:
            continue
        lens = numbers.setdefault(view.camera.intrinsics, len(numbers) + 1)
        rows = seen.get(view.name, np.zeros(0, dtype=np.int64))
        xy, depth = view.camera.project(points.xyz[rows])
        ahead = depth > 0
        pose = view.camera.rotation, view.camera.translation
        images[number] = SparseImage(view.photo.name, lens, *pose, xy[ahead], rows[ahead])
    cameras = {number: _pinhole(intrinsics) for intrinsics, number in numbers.items()}
    unknown = np.full(len(points.xyz), NO_ERROR)
    return SparseModel(cameras, images, points.xyz, points.rgb, unknown)


def with_held_out(model: SparseModel, capture: PreparedCapture) -> SparseModel:
    """Add the held-out views, whose cameras came with the capture, to a model of the others."""
    cameras, images = dict(model.cameras), dict(model.images)
    none = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    for view in capture.views:
        if view.split != "test" or view.camera is None:
            continue
        camera = _pinhole(view.camera.intrinsics)
        number = next((n for n, c in cameras.items() if c == camera), max(cameras, default=0) + 1)
        cameras[number] = camera
        pose = view.camera.rotation, view.camera.translation
        images[max(images, default=0) + 1] = SparseImage(view.photo.name, number, *pose, *none)
    return replace(model, cameras=cameras, images=images)


def write_no_keypoints(capture: PreparedCapture, path: Path) -> None:
    """Write the file of key points that goes with a scene for which none were sought."""
    names = np.array([view.name for view in capture.views])
    counts = np.zeros(len(names), dtype=np.int64)
    xy, inside = np.zeros((0, 2), dtype=np.float32), np.zeros(0, dtype=bool)
    none = np.zeros((0, 2), dtype=np.uint32)
    np.savez_compressed(
        path,
        names=names,
        counts=counts,
        xy=xy,
        inside=inside,
        pairs=none,
        pair_counts=none[:, 0],
        matches=none,
    )


def _pinhole(i: Intrinsics) -> ColmapCamera:
    return ColmapCamera("PINHOLE", i.width, i.height, (i.fx, i.fy, i.cx, i.cy))


def _seen_by(points: GivenPoints) -> dict[str, NDArray[np.int64]]:
    """Return the rows of the points that each photo is known to see, by the view's name."""
    order = np.argsort(points.seen[:, 0], kind="stable")
    seen = points.seen[order]
    cuts = np.searchsorted(seen[:, 0], np.arange(1, len(points.photos)))
    parts = np.split(seen[:, 1], cuts)
    return dict(zip(points.photos, parts, strict=False))
