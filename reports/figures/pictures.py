"""Stored renders and truths of the held-out views, and which parts of them a figure shows.

Nothing is rendered here: the pictures are those that were scored. What is missing is listed, so
that a report can say so. The choices that a figure makes are rules, stated in its caption:

* **views**: the held-out views at a quarter and three quarters of the list sorted by name; blind
  to content, so that nobody picks flattering ones;
* **zoom**: the square window, a quarter of the shorter side, where the renders of different
  methods differ most from one another (mean absolute difference, summed over backgrounds),
  counted on the object alone where its mask is stored: what differs most over a whole frame is
  the desk behind it. Where no two methods share a background, the window in which the renders
  differ most from their ground truth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from reports.rows.schema import Cell, Row, capture_name, condition_name

Floats = NDArray[np.float32]
SPLIT = "test"
ZOOM_SHARE = 4  # the window's side is the shorter side of the picture divided by this
QUARTERS = (0.25, 0.75)


@dataclass(frozen=True)
class Window:
    """A square part of a picture, pixels."""

    left: int
    top: int
    side: int

    def cut(self, picture: Floats) -> Floats:
        """Return the part of a picture [H, W, ...]."""
        return picture[self.top : self.top + self.side, self.left : self.left + self.side]


@dataclass
class Gallery:
    """Paths of one capture's pictures; ``missing`` says what was not found."""

    capture: str
    rows: dict[str, Row] = field(default_factory=dict)  # by condition
    truths: dict[tuple[str, str], Path] = field(default_factory=dict)  # by background, view
    renders: dict[tuple[str, str], Path] = field(default_factory=dict)  # by condition, view
    masks: dict[str, Path] = field(default_factory=dict)  # by view
    missing: list[tuple[str, str]] = field(default_factory=list)  # condition, what it lacks

    @property
    def views(self) -> list[str]:
        """Views that every condition rendered."""
        names = [{v for c, v in self.renders if c == condition} for condition in self.conditions]
        return sorted(set.intersection(*names)) if names else []

    @property
    def conditions(self) -> list[str]:
        """Conditions with pictures, in the order of the tables."""
        return [name for name in self.rows if any(c == name for c, _ in self.renders)]

    def chosen(self) -> list[str]:
        """Return the views that a figure shows (see the module's rule)."""
        views = self.views
        places = [min(len(views) - 1, int(len(views) * quarter)) for quarter in QUARTERS]
        return list(dict.fromkeys(views[place] for place in places)) if views else []

    def truth(self, condition: str, view: str) -> Floats:
        """Read the ground truth that a condition's render was scored against."""
        return read(self.truths[self.rows[condition]["background"], view])

    def render(self, condition: str, view: str) -> Floats:
        """Read a render."""
        return read(self.renders[condition, view])


def gallery(capture: str, all_cells: Sequence[Cell], root: Path | None) -> Gallery:
    """Find one capture's pictures: of each cell's lowest finished seed that has them here."""
    out = Gallery(capture)
    for cell in all_cells:
        if cell.key.capture != capture or not cell.finished:
            continue
        condition = cell.key.condition
        kept = [row for row in cell.finished if artifact(row, "evaluate", root)]
        row = out.rows[condition] = (kept or list(cell.finished))[0]
        folder = artifact(row, "evaluate", root)
        if folder is None:
            out.missing.append((condition, "no stored renders"))
            continue
        renders, truths = _pictures(folder / "renders"), _pictures(folder / "truth")
        for view in sorted(renders.keys() & truths.keys()):
            out.renders[condition, view] = renders[view]
            out.truths.setdefault((cell.key.background, view), truths[view])
        out.masks |= _pictures(folder / "masks")
        lacking = sorted(truths.keys() - renders.keys())
        out.missing += [(condition, f"no render of {view}") for view in lacking]
        if not renders:
            out.missing.append((condition, f"no renders in {folder.name}"))
    return out


def missing_pictures(galleries: Sequence[Gallery]) -> list[str]:
    """Say what is missing, one sentence per reason: of whole captures, then of their conditions."""
    by_reason: dict[str, list[str]] = {}
    part: list[str] = []
    for found in galleries:
        reasons: dict[str, list[str]] = {}
        for condition, reason in found.missing:
            reasons.setdefault(reason, []).append(condition)
        for reason, conditions in reasons.items():
            if len(conditions) == len(found.rows):
                by_reason.setdefault(reason, []).append(capture_name(found.capture))
                continue
            rows = [found.rows[condition] for condition in conditions]
            names = ", ".join(condition_name(row["background"], row["method"]) for row in rows)
            part.append(f"{capture_name(found.capture)}, {names}: {reason}")
    return [f"{', '.join(names)}: {reason}" for reason, names in by_reason.items()] + part


def artifact(row: Row, kind: str, root: Path | None) -> Path | None:
    """Return the folder of one of a row's artifacts, or None where it has none on this disk."""
    name: str | None = (row.get("artifacts") or {}).get(kind)
    if root is None or not name or not (root / name).is_dir():
        return None
    return root / name


def _pictures(folder: Path) -> dict[str, Path]:
    """Map views (``0008.jpg``) to files (``0008.jpg.png``)."""
    return {path.name.removesuffix(".png"): path for path in sorted((folder / SPLIT).glob("*.png"))}


def read(path: Path) -> Floats:
    """Read a picture as float32 [H, W, 3] in [0, 1]."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=np.float32) / np.float32(255)


def methods_compare(found: Gallery) -> bool:
    """Say whether two methods share a background, so that there is a difference to zoom in on."""
    backgrounds = [found.rows[condition]["background"] for condition in found.conditions]
    return len(set(backgrounds)) < len(backgrounds)


def zoom(found: Gallery, view: str) -> Window:
    """Return the window where methods, or renders and truth, differ most (see the rule above)."""
    pictures: dict[str, list[Floats]] = {}
    compare = methods_compare(found)
    for condition in found.conditions:
        background = found.rows[condition]["background"]
        group = pictures.setdefault(background, [])
        group.append(found.render(condition, view))
        if not compare:
            group.append(found.truth(condition, view))
    mask = found.masks.get(view)
    return widest(pictures, None if mask is None else read(mask)[:, :, 0])


def widest(pictures: Mapping[str, Sequence[Floats]], share: Floats | None = None) -> Window:
    """Find the window of the largest summed range between pictures of the same background.

    ``share`` [H, W] says how much each pixel counts; None: all alike.
    """
    shape = next(iter(pictures.values()))[0].shape
    total = np.zeros(shape[:2], dtype=np.float64)
    for group in pictures.values():
        stack = np.stack(group)
        total += (stack.max(axis=0) - stack.min(axis=0)).mean(axis=2)
    if share is not None and share.any():
        total *= share
    side = max(8, min(shape[:2]) // ZOOM_SHARE)
    sums = np.pad(total, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    boxes = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    top, left = np.unravel_index(int(boxes.argmax()), boxes.shape)
    return Window(int(left), int(top), side)


def error(render: Floats, truth: Floats) -> Floats:
    """Mean absolute difference over the channels, [H, W]."""
    difference: Floats = np.abs(render - truth).mean(axis=2)
    return difference
