"""A condition's training views as another program reads them.

What is written is what the built-in methods see: the registered training views alone, shrunk to the
training's resolution, composited where the background is removed, with their pinhole cameras and
the points that training starts from. Nothing of a test view is there, its name included.

=========== ============================================================================
colmap      ``images/NAME.png``, ``sparse/0/{cameras,images,points3D}.bin``
nerfstudio  ``images/NAME.png``, ``transforms.json``, ``points.ply``
nerf        ``train/NAME.png``, ``transforms_train.json``, ``transforms_test.json`` without
            frames, since readers want one, and ``points3d.ply``
=========== ============================================================================
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.formats.colmap_model import write_model
from mattgs_ops.capture.photos import write_png
from mattgs_ops.capture.scene import Scene
from mattgs_ops.capture.sparse import NO_ERROR, SparseImage, SparseModel
from mattgs_ops.errors import StageError
from mattgs_ops.frozen import Background
from mattgs_ops.splat.photos import StoredView, store_views
from mattgs_ops.splat.training.initialise import StartingPoints, starting_points
from mattgs_ops.trainer import Layout

FEWEST_VIEWS = 2
CENTRED = 0.5  # pixels that a principal point may lie off the middle in NeRF's layout
SAME_FOCAL = 1e-3  # relative; of views that share one angle there


def write_dataset(
    scene: Scene,
    background: Background,
    folder: Path,
    *,
    layout: Layout,
    resolution: int,
    most_points: int,
    seed: int,
) -> tuple[list[StoredView], StartingPoints]:
    """Write the training views of a scene into ``folder``; return them and the points.

    ``resolution`` is the longest side in pixels. Raises :class:`StageError` for a scene with too
    few views, or one that the layout cannot hold.
    """
    chosen = scene.registered("train")
    if len(chosen) < FEWEST_VIEWS:
        raise StageError(
            f"scene {scene.name}: expected {FEWEST_VIEWS} registered training views at least, "
            f"found {len(chosen)}"
        )
    views = store_views(chosen, background, resolution)
    points = starting_points(scene.points(), views, background, seed).at_most(most_points, seed)
    images = folder / ("train" if layout == "nerf" else "images")
    for view in views:
        write_png(images / _file(view), view.image)
    if layout == "colmap":
        write_model(_model(views, points), folder / "sparse" / "0")
    elif layout == "nerfstudio":
        _write_json(folder / "transforms.json", _nerfstudio(views))
        _write_points(points, folder / "points.ply")
    else:
        angle = {"camera_angle_x": _shared_angle(views)}
        frames = [_frame(view, f"./train/{Path(_file(view)).stem}") for view in views]
        _write_json(folder / "transforms_train.json", angle | {"frames": frames})
        _write_json(folder / "transforms_test.json", angle | {"frames": []})
        _write_points(points, folder / "points3d.ply", normals=True)  # the release reads them
    return views, points


def _file(view: StoredView) -> str:
    return f"{view.name}.png"


def _model(views: Sequence[StoredView], points: StartingPoints) -> SparseModel:
    """Return a COLMAP model with a pinhole camera for every view, and points without tracks."""
    cameras, images = {}, {}
    nothing = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    for number, view in enumerate(views, start=1):
        lens, pose = view.camera.intrinsics, view.camera
        numbers = (lens.fx, lens.fy, lens.cx, lens.cy)
        cameras[number] = ColmapCamera("PINHOLE", lens.width, lens.height, numbers)
        images[number] = SparseImage(_file(view), number, pose.rotation, pose.translation, *nothing)
    error = np.full(len(points.xyz), NO_ERROR)
    return SparseModel(cameras, images, points.xyz, _colours(points), error)


def _nerfstudio(views: Sequence[StoredView]) -> dict[str, Any]:
    frames = []
    for view in views:
        lens = view.camera.intrinsics
        numbers = {"fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy}
        frames.append(
            _frame(view, f"images/{_file(view)}") | numbers | {"w": lens.width, "h": lens.height}
        )
    # numbers that all frames share at the top too, where readers of one camera look; only those,
    # as nerfstudio takes what stands there for every frame
    first = {k: v for k, v in frames[0].items() if k not in ("file_path", "transform_matrix")}
    shared = {k: v for k, v in first.items() if all(frame[k] == v for frame in frames)}
    head = {"camera_model": "PINHOLE", "ply_file_path": "points.ply"}
    return head | shared | {"frames": frames}


def _frame(view: StoredView, path: str) -> dict[str, Any]:
    return {"file_path": path, "transform_matrix": to_opengl(view.camera).tolist()}


def to_opengl(camera: Camera) -> NDArray[np.float64]:
    """Return camera-to-world [4, 4] in OpenGL's axes, the inverse of ``camera.from_opengl``."""
    out = np.eye(4)
    out[:3, :3] = camera.rotation.T * [1.0, -1.0, -1.0]
    out[:3, 3] = camera.centre
    return out


def _shared_angle(views: Sequence[StoredView]) -> float:
    """Return the horizontal angle of view in radians that all views share.

    Raises :class:`StageError` where they do not, or where the axis is not in the picture's middle.
    """
    angles = []
    for view in views:
        lens = view.camera.intrinsics
        off = max(abs(lens.cx - lens.width / 2), abs(lens.cy - lens.height / 2))
        if off > CENTRED or abs(lens.fx / lens.fy - 1) > SAME_FOCAL:
            raise StageError(
                f"view {view.name}: layout `nerf` holds square pixels around the middle alone, "
                f"found fx {lens.fx:.2f}, fy {lens.fy:.2f} and an axis {off:.2f} pixels off; use "
                "the layout `colmap` or `nerfstudio`"
            )
        angles.append(2 * np.arctan(lens.width / (2 * lens.fx)))
    if max(angles) > min(angles) * (1 + SAME_FOCAL):
        raise StageError(
            f"layout `nerf` holds one angle for all views, found {min(angles):.4f} to "
            f"{max(angles):.4f} radians; use the layout `colmap` or `nerfstudio`"
        )
    return float(np.mean(angles))


def _colours(points: StartingPoints) -> NDArray[np.uint8]:
    rounded: NDArray[np.uint8] = np.clip(np.rint(points.rgb * 255), 0, 255).astype(np.uint8)
    return rounded


def _write_points(points: StartingPoints, path: Path, *, normals: bool = False) -> None:
    """Write positions and colours alone, as some readers take no other property, or 0 normals."""
    axes = ("x", "y", "z", *(("nx", "ny", "nz") if normals else ()))
    kinds = [(axis, "<f4") for axis in axes] + [(c, "u1") for c in ("red", "green", "blue")]
    rows = np.zeros(len(points.xyz), dtype=kinds)
    for axis, column in zip("xyz", points.xyz.T, strict=True):
        rows[axis] = column
    for name, column in zip(("red", "green", "blue"), _colours(points).T, strict=True):
        rows[name] = column
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(path))


def _write_json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
