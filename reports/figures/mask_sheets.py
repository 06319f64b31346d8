"""Sheets of photos with the outlines of their masks, on which everything after them is built."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.segment.mask_report import MaskReport
from reports.figures.picture_grid import canvas, clear, show
from reports.figures.pictures import artifact
from reports.figures.plots import Saved, save
from reports.rows.schema import Row, capture_name

MOST = 24  # photos of a sheet, evenly spaced; flagged ones come first
LANES = 6
WIDTH = 320  # pixels of one photo
OUTLINE = (255, 40, 30)
SOURCES = {
    "given": "came with the photos",
    "grabcut": "are GrabCut's",
    "none": "cover everything",
}


def sheet(rows: Sequence[Row], capture: str, root: Path | None, folder: Path) -> Saved | None:
    """Draw the sheet of one capture; None where its scene is not on this disk."""
    found = (
        artifact(row, "scene", root)
        for row in rows
        if row["capture"] == capture and row.get("artifacts")
    )
    place = next((one for one in found if one is not None), None)
    if place is None or not (place / "scene.json").is_file():
        return None
    scene, flags = Scene.load(place), _flags(place)
    drawn = [
        v for v in scene.views if v.mask is not None and v.mask.is_file() and v.photo.is_file()
    ]
    if not drawn:
        return None
    caption = _caption(capture, scene, min(MOST, len(drawn)), flags, place)
    return draw(drawn, flags, folder, f"figure-masks-{capture}", caption)


def draw(
    views: Sequence[View],
    flags: Mapping[str, tuple[str, ...]],
    folder: Path,
    slug: str,
    caption: str,
    *,
    all_registered: bool = False,
) -> Saved:
    """Draw outlines on photos; ``flags`` by view, and who has no camera, stand above them."""
    chosen = _chosen(views, flags)
    pictures = [_outlined(view) for view in chosen]
    lanes = min(LANES, len(chosen))
    figure, grid = canvas(-(-len(chosen) // lanes), lanes, pictures[0], block=1)
    places = grid.ravel()
    for axes, view, picture in zip(places, chosen, pictures, strict=False):
        show(axes, picture)
        lost = view.camera is None and not all_registered
        told = [*flags.get(view.name, ()), *(["no camera"] if lost else [])]
        colour = "#b3261e" if told else "black"
        axes.set_title(", ".join([view.name, *told]), fontsize=6, color=colour, pad=2)
    clear(places[None, len(chosen) :])
    return save(figure, folder, slug, caption, pictorial=True)


def _caption(
    capture: str, scene: Scene, drawn: int, flags: dict[str, tuple[str, ...]], place: Path
) -> str:
    """Say whose masks these are, and list every flag."""
    source = MaskReport.load(place / "masks.json").source if _has_report(place) else ""
    agreement = scene.extra.get("agreement") or {}
    whose = {
        "votes": "were voted on by all views",
        "maps": "are the network's, corrected by all views",
    }.get(str(agreement.get("masks", "")), SOURCES.get(source, "are the network's"))
    shown = f"{drawn} of {len(scene.views)} photos" if drawn < len(scene.views) else "all photos"
    told = "; ".join(f"{name}: {', '.join(found)}" for name, found in flags.items() if found)
    return (
        f"{capture_name(capture)}. Outlines of the masks, {shown}. Masks {whose}. "
        f"{f'Flags: {told}.' if told else 'No photo carries a flag.'}"
    )


def _has_report(place: Path) -> bool:
    return (place / "masks.json").is_file()


def _flags(place: Path) -> dict[str, tuple[str, ...]]:
    if not _has_report(place):
        return {}
    return {view.name: view.flags for view in MaskReport.load(place / "masks.json").views}


def _chosen(views: Sequence[View], flags: Mapping[str, tuple[str, ...]]) -> list[View]:
    """Keep the flagged ones first, then others evenly; in the photos' order."""
    flagged = [view for view in views if flags.get(view.name)][:MOST]
    rest = [view for view in views if view not in flagged]
    room = min(MOST - len(flagged), len(rest))
    places: NDArray[np.int64] = np.linspace(0, len(rest) - 1, room).round().astype(np.int64)
    kept = {view.name for view in [*flagged, *(rest[place] for place in places)]}
    return [view for view in views if view.name in kept]


def _outlined(view: View) -> NDArray[np.float32]:
    """Read a photo, small, with its mask's outline drawn [H, W, 3] in [0, 1]."""
    photo = cv2.imread(str(view.photo), cv2.IMREAD_COLOR)
    mask = cv2.imread(str(view.mask), cv2.IMREAD_GRAYSCALE)
    if photo is None or mask is None:
        return np.ones((view.height, view.width, 3), np.float32)
    size = (WIDTH, max(1, round(WIDTH * view.height / view.width)))
    small = cv2.resize(photo, size, interpolation=cv2.INTER_AREA)[..., ::-1].copy()
    shrunk = cv2.resize(mask, size, interpolation=cv2.INTER_AREA)
    lines, _ = cv2.findContours(
        (shrunk > 127).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
    )
    cv2.drawContours(small, lines, -1, OUTLINE, 1, cv2.LINE_AA)
    return np.asarray(small / np.float32(255), dtype=np.float32)
