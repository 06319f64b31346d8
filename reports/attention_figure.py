"""The attention figure: photo, grey, gradients, attention, and what attention pruned."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from mattgs_ops.attention import paper_attention
from mattgs_ops.scene import Scene
from reports.figures import Saved, save, sheets
from reports.picture_grid import bare, canvas, show, side
from reports.pictures import Floats, Gallery, artifact
from reports.rows import background_name, capture_name

START = "start.npz"  # of a training: starting points, and which were kept


def attention(galleries: Sequence[Gallery], root: Path | None, folder: Path) -> list[Saved]:
    """Photo, grey, both gradients, A and what it pruned, per capture, on what training sees."""
    usable = [g for g in galleries if g.views]
    return [_attention(part, root, folder, slug, sheet) for slug, sheet, part in sheets(usable)]


def _attention(
    usable: Sequence[Gallery], root: Path | None, folder: Path, slug: str, sheet: str
) -> Saved:
    titles = ["Image", "Grey", "|horizontal gradient|", "|vertical gradient|", "Attention A"]
    pruned = {found.capture: _pruned(found, root) for found in usable}
    if any(found is not None for found in pruned.values()):
        titles.append("Pruned at the start")
    first = _attention_image(usable[0])[1]
    figure, grid = canvas(len(usable), len(titles), first)
    for level, found in enumerate(usable):
        condition, image = _attention_image(found)
        label = background_name(found.rows[condition]["background"])
        grey = image.mean(axis=2)
        horizontal, vertical = _gradients(grey)
        parts = (image, grey, horizontal, vertical, paper_attention(image))
        if len(titles) > len(parts):
            grid[0][-1].set_title(titles[-1], fontsize=7.5)
            _pruned_points(grid[level][-1], image, pruned[found.capture])
        for axes, part, title in zip(grid[level], parts, titles[: len(parts)], strict=False):
            top = 1.0 if part.ndim == 3 or title in {"Grey", "Attention A"} else float(part.max())
            axes.imshow(part, cmap="gray", vmin=0, vmax=top or 1.0)
            bare(axes)
            if level == 0:
                axes.set_title(title, fontsize=7.5)
        side(grid[level][0], f"{capture_name(found.capture)}\n{label}")
    caption = (
        "Attention: the image, its grey (mean of red, green and blue), the two Sobel gradients "
        "and A of eqs. 9–14, their magnitude stretched to 0–1 over the image. On the white "
        "composite the cut-out's own outline answers strongest."
    )
    if len(titles) > 5:
        caption += (
            " Last, the points that training could start from: orange ones were dropped because "
            "their attention is low in the training views that see them, grey ones stayed."
        )
    return save(figure, folder, f"figure-attention{slug}", caption + sheet, pictorial=True)


def _attention_image(found: Gallery) -> tuple[str, Floats]:
    """Return a condition and an image that Ours trains on: the white composite if there is one."""
    without = [c for c in found.conditions if found.rows[c]["background"] == "nobg"]
    condition = (without or found.conditions)[-1]
    return condition, found.truth(condition, found.chosen()[0])


def _pruned(found: Gallery, root: Path | None) -> tuple[Floats, NDArray[np.bool_]] | None:
    """Return pixels [P, 2] of the starting points in the view shown, and which stayed."""
    condition, image = _attention_image(found)
    row = found.rows[condition]
    train, place = artifact(row, "train", root), artifact(row, "scene", root)
    if train is None or place is None or not (train / START).is_file():
        return None
    cameras = {view.name: view.camera for view in Scene.load(place).views}
    camera = cameras.get(found.chosen()[0])
    if camera is None:
        return None
    height, width = image.shape[:2]
    with np.load(train / START) as told:
        xyz, kept = told["xyz"].astype(np.float64), told["kept"]
    xy, depth = camera.scaled(width, height).project(xyz)
    inside = (depth > 0) & ((xy >= 0) & (xy < [width, height])).all(axis=1)
    return xy[inside].astype(np.float32), kept[inside]


def _pruned_points(
    axes: Axes, image: Floats, found: tuple[Floats, NDArray[np.bool_]] | None
) -> None:
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
