"""The attention figure: photo, grey, gradients, attention, and what attention pruned."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, in_frame
from mattgs_ops.capture.scene import Scene
from mattgs_ops.splat.attention import paper_attention
from reports.figures.picture_grid import above, bare, canvas, show, side
from reports.figures.pictures import Floats, Gallery, artifact
from reports.figures.plots import Saved, save, sheets
from reports.rows.schema import background_name, capture_name

Points = tuple[Floats, NDArray[np.bool_]]
PAPERS_METHOD = "ours"
START = "start.npz"  # of a training: starting points, and which were kept
PRUNED = "pruned.npz"  # of a training: centres of the splats that attention removed later
START_TITLE, LATER_TITLE = "Pruned at the start", "Pruned while training"
CAPTIONS = {
    START_TITLE: (
        " Then the points that training could start from: orange ones were dropped because their "
        "attention is low in the training views that see them, grey ones stayed."
    ),
    LATER_TITLE: (
        " Last, where splats stood when they were removed during training for low opacity and low "
        "attention."
    ),
}


def attention(galleries: Sequence[Gallery], root: Path | None, folder: Path) -> list[Saved]:
    """Photo, grey, both gradients, A and what it pruned, per capture, on what training sees."""
    usable = [g for g in galleries if g.views]
    return [_attention(part, root, folder, slug, sheet) for slug, sheet, part in sheets(usable)]


def _attention(
    usable: Sequence[Gallery], root: Path | None, folder: Path, slug: str, sheet: str
) -> Saved:
    points = [_points(found, root) for found in usable]
    panels = [name for name in (START_TITLE, LATER_TITLE) if any(name in p for p in points)]
    titles = ["Image", "Grey", "|horizontal gradient|", "|vertical gradient|", "Attention A"]
    first = _attention_image(usable[0])[1]
    figure, grid = canvas(len(usable), len(titles) + len(panels), first)
    for axes, title in zip(grid[0], titles + panels, strict=True):
        above(axes, title)
    for level, found in enumerate(usable):
        condition, image = _attention_image(found)
        label = background_name(found.rows[condition]["background"])
        grey = image.mean(axis=2)
        horizontal, vertical = _gradients(grey)
        parts = (image, grey, horizontal, vertical, paper_attention(image))
        for axes, part, title in zip(grid[level], parts, titles, strict=False):
            top = 1.0 if part.ndim == 3 or title in {"Grey", "Attention A"} else float(part.max())
            axes.imshow(part, cmap="gray", vmin=0, vmax=top or 1.0)
            bare(axes)
        for axes, name in zip(grid[level][len(titles) :], panels, strict=True):
            _draw_points(axes, image, points[level].get(name))
        side(grid[level][0], f"{capture_name(found.capture)}\n{label}")
    caption = (
        "Attention: the image, its grey (mean of red, green and blue), the two Sobel gradients "
        "and A of eqs. 9–14, their magnitude stretched to 0–1 over the image. On the white "
        "composite the cut-out's own outline answers strongest."
    )
    caption += "".join(CAPTIONS[name] for name in panels)
    return save(figure, folder, f"figure-attention{slug}", caption + sheet, pictorial=True)


def _attention_image(found: Gallery) -> tuple[str, Floats]:
    """Return a condition and its image: Ours on the white composite, or the nearest to that."""

    def nearness(condition: str) -> tuple[bool, bool]:
        row = found.rows[condition]
        return row["background"] == "nobg", row["method"] == PAPERS_METHOD

    condition = max(found.conditions, key=nearness)
    return condition, found.truth(condition, found.chosen()[0])


def _points(found: Gallery, root: Path | None) -> dict[str, Points]:
    """Return what is known of points by panel: at the start, and while training."""
    condition, image = _attention_image(found)
    row = found.rows[condition]
    train, place = artifact(row, "train", root), artifact(row, "scene", root)
    if train is None or place is None:
        return {}
    view = next((v for v in Scene.load(place).views if v.name == found.chosen()[0]), None)
    if view is None or view.camera is None:
        return {}
    camera = view.camera.scaled(image.shape[1], image.shape[0])
    panels = {}
    if (train / START).is_file():
        with np.load(train / START) as start:
            panels[START_TITLE] = _visible(camera, start["xyz"], start["kept"])
    if (train / PRUNED).is_file():
        with np.load(train / PRUNED) as pruned:
            none = np.zeros(len(pruned["xyz"]), np.bool_)
            panels[LATER_TITLE] = _visible(camera, pruned["xyz"], none)
    return panels


def _visible(camera: Camera, xyz: Floats, kept: NDArray[np.bool_]) -> Points:
    """Return pixels [P, 2] of the points in the frame, and which of them stayed."""
    i = camera.intrinsics
    xy, depth = camera.project(xyz.astype(np.float64))
    inside = in_frame(xy, depth, (i.width, i.height))
    return xy[inside].astype(np.float32), kept[inside]


def _draw_points(axes: Axes, image: Floats, found: Points | None) -> None:
    show(axes, image * np.float32(0.35) + np.float32(0.65))
    if found is None:
        return
    xy, kept = found
    for chosen, colour, size in ((kept, "#9aa5b1", 1.0), (~kept, "#D55E00", 3.0)):
        x, y = (xy[chosen] - 0.5).T
        axes.scatter(x, y, s=size, c=colour, linewidths=0, rasterized=True)


def _gradients(grey: Floats) -> tuple[Floats, Floats]:
    """Return the absolute Sobel responses, with the border that the attention map uses."""
    border = cv2.BORDER_REFLECT_101
    horizontal = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3, borderType=border)
    vertical = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=3, borderType=border)
    return np.abs(horizontal), np.abs(vertical)
