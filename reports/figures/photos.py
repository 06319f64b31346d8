"""Figures that show photos: masked SfM, the comparison of methods, error maps."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from mattgs_ops.capture.camera import in_frame
from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.capture.sparse import OBJECT_SHARE, are_on_object
from reports.figures import findings, pictures
from reports.figures.picture_grid import GAP, TOP, above, bare, canvas, clear, show, side
from reports.figures.pictures import Floats, Gallery, Window, artifact
from reports.figures.plots import Saved, save, sheets
from reports.rows.schema import Row, background_name, capture_name, method_name

Lane = tuple[str, str, bool]  # title, condition, is truth
SCALE = 0.5  # inches for a colour scale
MOST_LANES = 6  # pictures side by side; with more, each background has rows of its own
MARK = "#ffd400"  # the frame around a zoomed part
ERROR_TOP = 0.25  # error at which the colour scale ends, of 1


def comparison(found: Gallery, folder: Path) -> Saved | None:
    """Ground truth, then each condition, for two held-out views, with zoomed parts below."""
    views = found.chosen()
    if not views:
        return None
    blocks = _blocks(_lanes(found))
    windows = {view: pictures.zoom(found, view) for view in views}
    first, each = found.truth(blocks[0][0][1], views[0]), 2 * len(views)
    figure, grid = canvas(each * len(blocks), max(map(len, blocks)), first, square=1, block=each)
    for start, lanes in enumerate(blocks):
        clear(grid[each * start : each * (start + 1), len(lanes) :])
        for place, view in enumerate(views):
            rows = grid[each * start + 2 * place :][:2]
            _compare(rows, lanes, found, view, windows[view], titled=place == 0)
    compare = pictures.methods_compare(found)
    what = "the methods" if compare else "render and ground truth"
    caption = (
        f"{capture_name(found.capture)}. {findings.on_views(found, views)}"
        f"Held-out views {' and '.join(views)} (at a quarter and "
        f"three quarters of the list sorted by name). The zoom is the window in which {what} "
        "differ most, counted on the object."
    )
    return save(figure, folder, f"figure-comparison-{found.capture}", caption, pictorial=True)


def _compare(
    rows: NDArray[np.object_],
    lanes: Sequence[Lane],
    found: Gallery,
    view: str,
    window: Window,
    *,
    titled: bool,
) -> None:
    """Show one view in two rows: whole pictures above, zoomed parts below."""
    for lane, (title, condition, is_truth) in enumerate(lanes):
        picture = found.truth(condition, view) if is_truth else found.render(condition, view)
        upper, lower = rows[0][lane], rows[1][lane]
        show(upper, picture)
        _frame(upper, window)
        show(lower, window.cut(picture))
        if titled:
            above(upper, title)
        if lane == 0:
            side(upper, view)
            side(lower, "zoom")


def error_maps(found: Gallery, folder: Path) -> Saved | None:
    """Absolute error of each condition on the same two views, one colour scale for all."""
    views = found.chosen()
    if not views:
        return None
    blocks = _blocks([lane for lane in _lanes(found) if not lane[2]])
    first, each = found.truth(blocks[0][0][1], views[0]), len(views)
    figure, grid = canvas(each * len(blocks), max(map(len, blocks)), first, right=SCALE, block=each)
    scale = ScalarMappable(Normalize(0, ERROR_TOP), "magma")
    for start, lanes in enumerate(blocks):
        clear(grid[each * start : each * (start + 1), len(lanes) :])
        for place, view in enumerate(views):
            for lane, (title, condition, _) in enumerate(lanes):
                wrong = pictures.error(found.render(condition, view), found.truth(condition, view))
                axes = grid[each * start + place][lane]
                axes.imshow(wrong, cmap=scale.get_cmap(), norm=scale.norm)
                bare(axes)
                if place == 0:
                    above(axes, title)
                if lane == 0:
                    side(axes, view)
    width, height = figure.get_size_inches()
    box = ((width - SCALE + 2 * GAP) / width, GAP / height, 0.1 / width, 1 - (TOP + GAP) / height)
    bar = figure.colorbar(scale, cax=figure.add_axes(box))
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=6)
    caption = (
        f"{capture_name(found.capture)}. {findings.on_views(found, views, error=True)}"
        "Absolute error against the ground truth of the same background, mean of the channels; "
        f"the scale ends at {ERROR_TOP} of 1."
    )
    return save(figure, folder, f"figure-errors-{found.capture}", caption, pictorial=True)


def masked_sfm(captures: Sequence[tuple[str, Row]], root: Path | None, folder: Path) -> list[Saved]:
    """Photo, masked photo and sparse points over the photo, per capture."""
    found = []
    for name, row in captures:
        place = artifact(row, "scene", root)
        if place is not None and (place / "scene.json").is_file():
            scene = Scene.load(place)
            view = scene.example_view()
            if view is not None:
                found.append((name, scene, view))
    return [_masked_sfm(part, folder, slug, sheet) for slug, sheet, part in sheets(found)]


def _masked_sfm(
    found: Sequence[tuple[str, Scene, View]], folder: Path, slug: str, sheet: str
) -> Saved:
    first = pictures.read(found[0][2].photo)
    titles = ("Photo", "Inside the mask", "Sparse points")
    figure, grid = canvas(len(found), len(titles), first, width=2.2)
    for level, (name, scene, view) in enumerate(found):
        photo = pictures.read(view.photo)
        show(grid[level][0], photo)
        show(grid[level][1], _on_white(photo, view))
        _points(grid[level][2], photo, scene, view)
        side(grid[level][0], capture_name(name))
        if level == 0:
            for axes, title in zip(grid[0], titles, strict=True):
                above(axes, title)
    caption = (
        "Masked structure-from-motion: a photo, what its mask keeps, and the sparse points that "
        f"project into it; orange ones are the object's: {OBJECT_SHARE * 100:.0f} % or more of the "
        f"views that see them have them in their masks{_on_object(found)}."
    )
    return save(figure, folder, f"figure-sfm{slug}", caption + sheet, pictorial=True)


def _on_object(found: Sequence[tuple[str, Scene, View]]) -> str:
    """Say which share of all sparse points lies on the object, per capture."""
    clouds = [(name, scene.points()) for name, scene, _ in found]
    shares = [
        f"{are_on_object(points).mean() * 100:.0f} % of {capture_name(name)}'s"
        for name, points in clouds
        if len(points.xyz)
    ]
    return f" ({', '.join(shares)})" if shares else ""


def _blocks(lanes: Sequence[Lane]) -> list[list[Lane]]:
    """Put all lanes side by side, or where that is too many those of each background."""
    if len(lanes) <= MOST_LANES:
        return [list(lanes)]
    grouped: dict[str, list[Lane]] = {}
    for lane in lanes:
        grouped.setdefault(lane[0].partition("\n")[0], []).append(lane)
    return list(grouped.values())


def _lanes(found: Gallery) -> list[Lane]:
    """List (title, condition, is truth): per background the truth, then each method."""
    lanes: list[Lane] = []
    seen = set()
    for condition in found.conditions:
        row = found.rows[condition]
        background = background_name(row["background"])
        if background not in seen:
            lanes.append((f"{background}\nground truth", condition, True))
            seen.add(background)
        lanes.append((f"{background}\n{method_name(row['method'])}", condition, False))
    return lanes


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


def _on_white(photo: Floats, view: View) -> Floats:
    if view.mask is None:
        return photo
    share = pictures.read(view.mask)
    mixed: Floats = photo * share + (1 - share)
    return mixed


def _points(axes: Axes, photo: Floats, scene: Scene, view: View) -> None:
    faded = photo * np.float32(0.35) + np.float32(0.65)
    show(axes, faded)
    points = scene.points()
    if view.camera is None or not len(points.xyz):
        return
    xy, depth = view.camera.project(points.xyz)
    inside = in_frame(xy, depth, (view.width, view.height))
    on_object = are_on_object(points)
    for chosen, colour in ((inside & ~on_object, "#7b8794"), (inside & on_object, "#D55E00")):
        axes.scatter(
            xy[chosen, 0] - 0.5, xy[chosen, 1] - 0.5, s=1.2, c=colour, linewidths=0, rasterized=True
        )
