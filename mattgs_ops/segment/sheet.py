"""The photos that stand for a capture's masks: which ones, and small copies of them.

A report draws outlines of masks on them (``reports/figures/mask_sheets.py``). The small copies are
what it draws on, so that one made from them is the same to the bit as one made from the photos.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.segment.mask_report import MaskReport

MOST = 24  # photos, evenly spaced; flagged ones come first
WIDTH = 320  # pixels of one photo
FOLDER = "sheet"  # of the copies, in a scene's folder
Bytes = NDArray[np.uint8]
Flags = Mapping[str, tuple[str, ...]]


def flags_of(scene: Path) -> dict[str, tuple[str, ...]]:
    """Return the flags of each view's mask; none where the scene's folder has no report of them."""
    report = scene / "masks.json"
    if not report.is_file():
        return {}
    return {view.name: view.flags for view in MaskReport.load(report).views}


def views_of(scene: Scene) -> list[View]:
    """Return the views that can be drawn: with the copies where there are some, else the photos."""
    copies = scene.folder / FOLDER
    views = [view for view in scene.views if view.mask is not None]
    if copies.is_dir():
        views = [_copy_of(view, copies) for view in views]
    return [v for v in views if v.mask is not None and v.mask.is_file() and v.photo.is_file()]


def _copy_of(view: View, folder: Path) -> View:
    name = f"{view.name}.png"
    return replace(view, photo=folder / "photos" / name, mask=folder / "masks" / name)


def chosen(views: Sequence[View], flags: Flags) -> list[View]:
    """Keep the flagged ones first, then others evenly; in the photos' order."""
    flagged = [view for view in views if flags.get(view.name)][:MOST]
    rest = [view for view in views if view not in flagged]
    room = min(MOST - len(flagged), len(rest))
    places: NDArray[np.int64] = np.linspace(0, len(rest) - 1, room).round().astype(np.int64)
    kept = {view.name for view in [*flagged, *(rest[place] for place in places)]}
    return [view for view in views if view.name in kept]


def small(view: View) -> tuple[Bytes, Bytes] | None:
    """Return photo [H, W, 3] (BGR) and mask [H, W], ``WIDTH`` wide; None where one is unreadable.

    Of a small copy that is the copy itself.
    """
    photo = cv2.imread(str(view.photo), cv2.IMREAD_COLOR)
    mask = cv2.imread(str(view.mask), cv2.IMREAD_GRAYSCALE)
    if photo is None or mask is None:
        return None
    size = (WIDTH, max(1, round(WIDTH * view.height / view.width)))
    pictures = (
        cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in (photo, mask)
    )
    smaller, outline = (np.asarray(picture, dtype=np.uint8) for picture in pictures)
    return smaller, outline


def write_copies(scene: Path, out: Path) -> None:
    """Write small copies of the chosen photos and masks of the scene in ``scene`` below ``out``."""
    for place, data in _encoded(scene).items():
        (out / place).parent.mkdir(parents=True, exist_ok=True)
        (out / place).write_bytes(data)


@lru_cache(maxsize=4)
def _encoded(folder: Path) -> dict[str, bytes]:
    """Return the copies as PNG, by their place; all experiments of a capture share them."""
    files = {}
    for view in chosen(views_of(Scene.load(folder)), flags_of(folder)):
        pictures = small(view)
        if pictures is not None:
            for kind, picture in zip(("photos", "masks"), pictures, strict=True):
                files[f"{kind}/{view.name}.png"] = cv2.imencode(".png", picture)[1].tobytes()
    return files
