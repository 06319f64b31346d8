"""A picture of what masks do to structure-from-motion, after the paper's Fig. 3.

Five panels: a photo, its mask, its key points without and with the mask, and the sparse cloud with
the cameras, seen from above.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import read_map
from mattgs_ops.capture.photos import read_rgb
from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.capture.sparse import are_on_object
from mattgs_ops.errors import InputError
from mattgs_ops.sfm.colmap.job import KEYPOINTS_FILE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
INCHES, DOTS = 3.2, 110  # of one panel
# The cloud is framed so that this share of its points is seen along each axis.
SHOWN = 0.98
OBJECT_COLOUR, OTHER_COLOUR, CAMERA_COLOUR = "#c43c39", "#9aa0a6", "#2a6f97"


def draw(scene: Scene, path: Path, view: str | None = None) -> None:
    """Draw a scene's five panels into ``path`` (PNG).

    ``view`` names the photo shown; by default the registered one with most key points on the
    object. Raises :class:`InputError` when there is no such view.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    keypoints = read_keypoints(scene.folder)
    shown = _choose(scene, keypoints, view)
    xy, inside = keypoints[shown.name]
    photo = read_rgb(shown.photo)
    if shown.mask is None:
        raise InputError(f"{scene.folder}: view {shown.name}: expected a mask, found none")
    mask = read_map(shown.mask)
    figure = Figure(figsize=(5 * INCHES, INCHES * 1.1), dpi=DOTS, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 5)
    for axis in axes[:4]:
        axis.set_axis_off()
    axes[0].imshow(photo)
    axes[0].set_title(shown.name, fontsize=9, parse_math=False)
    axes[1].imshow(mask, cmap="gray", vmin=0, vmax=255)
    axes[1].set_title("mask", fontsize=9)
    _scatter(axes[2], photo, xy, f"{len(xy)} key points")
    _scatter(axes[3], photo, xy[inside], f"{int(inside.sum())} inside the mask")
    _cloud(axes[4], scene)
    figure.savefig(path, metadata={"Software": None})


def read_keypoints(folder: Path) -> dict[str, tuple[Array, NDArray[np.bool_]]]:
    """Read a scene's key points: by view, ``xy`` [K, 2] in pixels and ``inside`` [K]."""
    with np.load(folder / KEYPOINTS_FILE) as data:
        cuts = np.cumsum(data["counts"])[:-1]
        xy, inside = np.split(data["xy"], cuts), np.split(data["inside"], cuts)
        return {str(n): (xy[k], inside[k]) for k, n in enumerate(data["names"])}


def from_above(scene: Scene, points: Array) -> tuple[Array, Array]:
    """Project points [P, 3] and the camera centres onto the plane that the cameras stand on.

    Up is the mean of the cameras' up directions. Returns [P, 2] and [C, 2], with the middle of
    the camera centres at the origin.
    """
    cameras = [v.camera for v in scene.views if v.camera is not None]
    up = -np.mean([c.rotation[1] for c in cameras], axis=0)
    centres = np.array([c.centre for c in cameras])
    middle = centres.mean(axis=0)
    # any two directions across ``up``: the rows of V that the singular value 0 leaves
    _, _, basis = np.linalg.svd(up[None])
    flat = basis[1:]
    if np.linalg.det(np.vstack([flat, up])) < 0:  # not mirrored
        flat = flat[::-1]
    return (points - middle) @ flat.T, (centres - middle) @ flat.T


def _choose(
    scene: Scene, keypoints: dict[str, tuple[Array, NDArray[np.bool_]]], name: str | None
) -> View:
    registered = [v for v in scene.views if v.camera is not None and v.name in keypoints]
    if name is not None:
        registered = [v for v in registered if v.name == name]
    if not registered:
        raise InputError(f"{scene.folder}: no registered view {name or ''} to show")
    return max(registered, key=lambda v: int(keypoints[v.name][1].sum()))


def _scatter(axis: "Axes", photo: NDArray[np.uint8], xy: Array, title: str) -> None:
    axis.imshow(photo, alpha=0.45)
    axis.scatter(xy[:, 0] - 0.5, xy[:, 1] - 0.5, s=2, c=OBJECT_COLOUR, linewidths=0)
    axis.set_title(title, fontsize=9)


def _cloud(axis: "Axes", scene: Scene) -> None:
    points = scene.points()
    flat, centres = from_above(scene, points.xyz)
    on_object = are_on_object(points)
    for xy, size, colour, marker in (
        (flat[~on_object], 1.5, OTHER_COLOUR, "o"),
        (flat[on_object], 1.5, OBJECT_COLOUR, "o"),
        (centres, 12.0, CAMERA_COLOUR, "^"),
    ):
        axis.scatter(xy[:, 0], xy[:, 1], s=size, c=colour, marker=marker, linewidths=0)
    low, high = centres.min(axis=0), centres.max(axis=0)
    if len(flat):
        # strays far beyond the cameras would shrink everything else
        reach = high - low + np.linalg.norm(high - low)
        strays = np.quantile(flat, [1 - SHOWN, SHOWN], axis=0)
        low = np.maximum(np.minimum(low, strays[0]), low - reach)
        high = np.minimum(np.maximum(high, strays[1]), high + reach)
    half = 0.54 * float((high - low).max())
    middle = (low + high) / 2
    axis.set_xlim(middle[0] - half, middle[0] + half)
    axis.set_ylim(middle[1] - half, middle[1] + half)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_title(f"{len(flat)} points, {int(on_object.sum())} on the object", fontsize=9)
