"""Figures that show photos: masked SfM, attention, the comparison of methods, error maps."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from mattgs_ops.attention import paper_attention
from mattgs_ops.scene import Scene, View
from mattgs_ops.scene_example import example
from reports import pictures
from reports.figures import Saved, save
from reports.pictures import Floats, Gallery, Window, artifact
from reports.rows import Cell, Row, background_name, capture_name, method_name

LEFT, TOP, GAP = 0.3, 0.32, 0.03  # inches: labels at the left, titles above, between pictures
SCALE = 0.5  # inches for a colour scale
CELL = 1.55  # inches that one picture is wide
MARK = "#ffd400"  # the frame around a zoomed part
ERROR_TOP = 0.25  # error at which the colour scale ends, of 1
START = "start.npz"  # of a training: starting points, and which were kept
OBJECT_SHARE = 0.5  # a sparse point counts as the object's above this


def comparison(found: Gallery, folder: Path) -> Saved | None:
    """Ground truth, then each condition, for two held-out views, with zoomed parts below."""
    views = found.chosen()
    if not views:
        return None
    lanes = _lanes(found)
    figure, grid = _canvas(2 * len(views), len(lanes), found.truth(lanes[0][1], views[0]), square=1)
    for place, view in enumerate(views):
        window = pictures.zoom(found, view)
        for lane, (title, condition, is_truth) in enumerate(lanes):
            picture = found.truth(condition, view) if is_truth else found.render(condition, view)
            upper, lower = grid[2 * place][lane], grid[2 * place + 1][lane]
            _show(upper, picture)
            _frame(upper, window)
            _show(lower, window.cut(picture))
            if place == 0:
                upper.set_title(title, fontsize=7.5)
            if lane == 0:
                _side(upper, view)
                _side(lower, "zoom")
    caption = (
        f"{capture_name(found.capture)}: held-out views {' and '.join(views)} (at a quarter and "
        "three quarters of the list sorted by name). The zoom is the window in which the methods "
        "differ most, counted on the object."
    )
    return save(figure, folder, f"figure-comparison-{found.capture}", caption, pictorial=True)


def error_maps(found: Gallery, folder: Path) -> Saved | None:
    """Absolute error of each condition on the same two views, one colour scale for all."""
    views = found.chosen()
    if not views:
        return None
    lanes = [lane for lane in _lanes(found) if not lane[2]]
    figure, grid = _canvas(len(views), len(lanes), found.truth(lanes[0][1], views[0]), right=SCALE)
    scale = ScalarMappable(Normalize(0, ERROR_TOP), "magma")
    for place, view in enumerate(views):
        for lane, (title, condition, _) in enumerate(lanes):
            wrong = pictures.error(found.render(condition, view), found.truth(condition, view))
            axes = grid[place][lane]
            axes.imshow(wrong, cmap=scale.get_cmap(), norm=scale.norm)
            _bare(axes)
            if place == 0:
                axes.set_title(title, fontsize=7.5)
            if lane == 0:
                _side(axes, view)
    width, height = figure.get_size_inches()
    box = ((width - SCALE + 2 * GAP) / width, GAP / height, 0.1 / width, 1 - (TOP + GAP) / height)
    bar = figure.colorbar(scale, cax=figure.add_axes(box))
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=6)
    caption = (
        f"{capture_name(found.capture)}: absolute error against the ground truth of the same "
        f"background, mean of the channels; the scale ends at {ERROR_TOP} of 1."
    )
    return save(figure, folder, f"figure-errors-{found.capture}", caption, pictorial=True)


def attention(galleries: Sequence[Gallery], root: Path | None, folder: Path) -> Saved | None:
    """Photo, grey, both gradients, A and what it pruned, per capture, on what training sees."""
    usable = [g for g in galleries if g.views]
    if not usable:
        return None
    titles = ["Image", "Grey", "|horizontal gradient|", "|vertical gradient|", "Attention A"]
    pruned = {found.capture: _pruned(found, root) for found in usable}
    if any(found is not None for found in pruned.values()):
        titles.append("Pruned at the start")
    first = _attention_image(usable[0])[1]
    figure, grid = _canvas(len(usable), len(titles), first)
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
            _bare(axes)
            if level == 0:
                axes.set_title(title, fontsize=7.5)
        _side(grid[level][0], f"{capture_name(found.capture)}\n{label}")
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
    return save(figure, folder, "figure-attention", caption, pictorial=True)


def masked_sfm(
    captures: Sequence[tuple[str, Row]], root: Path | None, folder: Path
) -> Saved | None:
    """Photo, masked photo and sparse points over the photo, per capture."""
    found = []
    for name, row in captures:
        place = artifact(row, "scene", root)
        if place is not None and (place / "scene.json").is_file():
            scene = Scene.load(place)
            view = example(scene)
            if view is not None:
                found.append((name, scene, view))
    if not found:
        return None
    first = pictures.read(found[0][2].photo)
    titles = ("Photo", "Inside the mask", "Sparse points")
    figure, grid = _canvas(len(found), len(titles), first, width=2.2)
    for level, (name, scene, view) in enumerate(found):
        photo = pictures.read(view.photo)
        _show(grid[level][0], photo)
        _show(grid[level][1], _on_white(photo, view))
        _points(grid[level][2], photo, scene, view)
        _side(grid[level][0], capture_name(name))
        if level == 0:
            for axes, title in zip(grid[0], titles, strict=True):
                axes.set_title(title, fontsize=7.5)
    caption = (
        "Masked structure-from-motion: a photo, what its mask keeps, and the sparse points that "
        "project into it; orange ones lie inside the masks of most views that see them."
    )
    return save(figure, folder, "figure-sfm", caption, pictorial=True)


def _lanes(found: Gallery) -> list[tuple[str, str, bool]]:
    """List (title, condition, is truth): per background the truth, then each method."""
    lanes: list[tuple[str, str, bool]] = []
    seen = set()
    for condition in found.conditions:
        row = found.rows[condition]
        background = background_name(row["background"])
        if background not in seen:
            lanes.append((f"{background}\nground truth", condition, True))
            seen.add(background)
        lanes.append((f"{background}\n{method_name(row['method'])}", condition, False))
    return lanes


def _canvas(
    rows: int,
    lanes: int,
    example: Floats,
    *,
    square: int = 0,
    width: float = CELL,
    right: float = 0,
) -> tuple[Figure, NDArray[np.object_]]:
    """Make a grid whose cells fit the example; with ``square`` every second row is square.

    Everything is placed by hand, in inches: automatic layouts draw the figure several times.
    ``right`` inches stay free beside the grid.
    """
    ratio = example.shape[0] / example.shape[1]
    heights = [width * (1.0 if square and row % 2 else ratio) for row in range(rows)]
    across = LEFT + lanes * (width + GAP) + right
    down = TOP + sum(heights) + rows * GAP
    figure = Figure(figsize=(across, down))
    grid = np.empty((rows, lanes), dtype=object)
    below = down - TOP
    for row, height in enumerate(heights):
        below -= height
        for lane in range(lanes):
            left = LEFT + lane * (width + GAP)
            box = (left / across, below / down, width / across, height / down)
            grid[row, lane] = figure.add_axes(box)
        below -= GAP
    return figure, grid


def _show(axes: Axes, picture: Floats) -> None:
    axes.imshow(picture, vmin=0, vmax=1, interpolation="nearest")
    _bare(axes)


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_linewidth(0.4)
        spine.set_color("#c4cad0")


def _side(axes: Axes, text: str) -> None:
    axes.set_ylabel(text, fontsize=6.5)


def _frame(axes: Axes, window: Window) -> None:
    axes.add_patch(
        Rectangle(
            (window.left - 0.5, window.top - 0.5),
            window.side,
            window.side,
            fill=False,
            edgecolor=MARK,
            linewidth=1.0,
        )
    )


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
    _show(axes, image * np.float32(0.35) + np.float32(0.65))
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


def _on_white(photo: Floats, view: View) -> Floats:
    if view.mask is None:
        return photo
    share = pictures.read(view.mask)
    mixed: Floats = photo * share + (1 - share)
    return mixed


def _points(axes: Axes, photo: Floats, scene: Scene, view: View) -> None:
    faded = photo * np.float32(0.35) + np.float32(0.65)
    _show(axes, faded)
    points = scene.points()
    if view.camera is None or not len(points.xyz):
        return
    xy, depth = view.camera.project(points.xyz)
    inside = (depth > 0) & ((xy >= 0) & (xy < [view.width, view.height])).all(axis=1)
    on_object = points.object_share > OBJECT_SHARE
    for chosen, colour in ((inside & ~on_object, "#7b8794"), (inside & on_object, "#D55E00")):
        axes.scatter(
            xy[chosen, 0] - 0.5, xy[chosen, 1] - 0.5, s=1.2, c=colour, linewidths=0, rasterized=True
        )


def all_photo_figures(
    galleries: Sequence[Gallery], mine: Sequence[Cell], root: Path | None, folder: Path
) -> list[Saved]:
    """Draw every figure of this module that has its pictures."""
    first = {cell.key.capture: cell.finished[0] for cell in reversed(mine) if cell.finished}
    names = [g.capture for g in galleries if g.capture in first]
    out = [masked_sfm([(name, first[name]) for name in names], root, folder)]
    out.append(attention(galleries, root, folder))
    for found in galleries:
        out += [comparison(found, folder), error_maps(found, folder)]
    return [figure for figure in out if figure is not None]
