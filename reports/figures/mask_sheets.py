"""Sheets of photos with the outlines of their masks, on which everything after them is built."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.segment.sheet import MOST, Flags, chosen, flags_of, small, views_of
from reports.figures.picture_grid import canvas, clear, show
from reports.figures.pictures import artifact
from reports.figures.plots import Saved, save
from reports.rows.schema import Row, capture_name

LANES = 6
LONGEST_NAME = 27  # letters that fit above one of LANES photos
OUTLINE = (255, 40, 30)
GROUND = 0.5  # its brightness in the sheet: a red outline on a red object does not show by itself
SOURCES = {
    "given": "came with the photos",
    "grabcut": "are GrabCut's",
    "none": "cover everything",
}


def sheet(rows: Sequence[Row], capture: str, root: Path | None, folder: Path) -> Saved | None:
    """Draw the sheet of one capture; None where its scene is not on this disk."""
    folders = (
        artifact(row, "scene", root)
        for row in rows
        if row["capture"] == capture and row.get("artifacts")
    )
    place = next((one for one in folders if one is not None), None)
    if place is None or not (place / "scene.json").is_file():
        return None
    scene, flags = Scene.load(place), flags_of(place)
    drawn = views_of(scene)
    if not drawn:
        return None
    caption = caption_of(capture, scene, min(MOST, len(drawn)), flags, place)
    return draw(drawn, flags, folder, f"figure-masks-{capture}", caption)


def draw(
    views: Sequence[View],
    flags: Flags,
    folder: Path,
    slug: str,
    caption: str,
    *,
    all_registered: bool = False,
    vector: bool = True,
) -> Saved:
    """Draw outlines on photos; ``flags`` by view, and who has no camera, stand above them.

    Without ``vector`` there is no PDF, which takes half of the time.
    """
    drawn = chosen(views, flags)
    pictures = [outlined(view) for view in drawn]
    lanes = min(LANES, len(drawn))
    figure, grid = canvas(-(-len(drawn) // lanes), lanes, pictures[0], block=1)
    places = grid.ravel()
    for axes, view, picture in zip(places, drawn, pictures, strict=False):
        show(axes, picture)
        lost = view.camera is None and not all_registered
        doubts = [*flags.get(view.name, ()), *(["no camera"] if lost else [])]
        colour = "#b3261e" if doubts else "black"
        axes.set_title(title(view.name, doubts), fontsize=6, color=colour, pad=2)
    clear(places[None, len(drawn) :])
    return save(figure, folder, slug, caption, pictorial=True, vector=vector)


def title(name: str, doubts: Sequence[str]) -> str:
    """Return a photo's name, without its middle where it is too long, and a line of doubts."""
    if len(name) > LONGEST_NAME:
        kept = (LONGEST_NAME - 1) // 2
        name = f"{name[:kept]}…{name[-kept:]}"
    return f"{name}\n{', '.join(doubts)}" if doubts else name


def caption_of(capture: str, scene: Scene, drawn: int, flags: Flags, place: Path) -> str:
    """Say whose masks these are, and list every flag."""
    report = place / "masks.json"
    source = MaskReport.load(report).source if report.is_file() else ""
    agreement = scene.extra.get("agreement") or {}
    whose = {
        "votes": "were voted on by the training views",
        "maps": "are the network's, corrected by the training views",
        "both": "are the mean of the network's and of what the training views voted",
    }.get(str(agreement.get("masks", "")), SOURCES.get(source, "are the network's"))
    count = f"{drawn} of {len(scene.views)} photos" if drawn < len(scene.views) else "all photos"
    flagged = "; ".join(
        f"{flag} ({len(names)}): {', '.join(names)}" for flag, names in _by_flag(flags).items()
    )
    network = int(agreement.get("network") or 0)
    if network:
        whose += f"; network {network} of the model file is used, surely better than their mean"
    return (
        f"{capture_name(capture)}. Outlines of the masks, {count}; the ground is dimmed. "
        f"Masks {whose}. "
        f"{f'Flags: {flagged}.' if flagged else 'No photo carries a flag.'}"
    )


def _by_flag(flags: Flags) -> dict[str, list[str]]:
    """Return the photos that carry each flag, flags in the order in which they appear."""
    photos: dict[str, list[str]] = {}
    for name, some in flags.items():
        for flag in some:
            photos.setdefault(flag, []).append(name)
    return photos


def outlined(view: View) -> NDArray[np.float32]:
    """Return a photo, small, its mask outlined and its ground dimmed [H, W, 3] in [0, 1]."""
    pictures = small(view)
    if pictures is None:
        return np.ones((view.height, view.width, 3), np.float32)
    photo, mask = pictures
    inside = mask > 127
    picture = np.where(inside[..., None], photo, photo * GROUND).astype(np.uint8)[..., ::-1].copy()
    lines, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, lines, -1, OUTLINE, 1, cv2.LINE_AA)
    return np.asarray(picture / np.float32(255), dtype=np.float32)
