"""Figures that plot numbers: quality against cost, training curves. And how all figures look.

Vector PDF and PNG of each; the same rows give the same bytes: fonts are embedded as they are, and
no file carries a date.
"""

import csv
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle, pairwise
from pathlib import Path
from typing import TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import StrMethodFormatter
from numpy.typing import NDArray

from mattgs_ops.method import METHODS
from reports.figures import findings
from reports.figures.pictures import artifact
from reports.figures.scales import plain_numbers
from reports.rows.columns import joined
from reports.rows.schema import (
    Cell,
    Row,
    capture_name,
    cells,
    condition_name,
    method_name,
)

# Okabe & Ito (2008): eight colours that colour-blind readers can tell apart
OWN_COLOUR = ("3dgs", "ours", "ours+")  # the first of the palette, and nobody else has them
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
# Lines and marks; the next of each where methods outnumber the colours. Lines have wide gaps with
# the background and narrow ones without it: (offset, (line, gap, ...)) in widths of the line.
Dash = str | tuple[int, tuple[float, ...]]
DASHES: dict[str, tuple[Dash, ...]] = {
    "original": ("--", (0, (1, 4)), (0, (5, 4, 1, 4)), (0, (5, 4, 1, 4, 1, 4)), (0, (12, 4))),
    "nobg": ("-", (0, (1, 1)), (0, (5, 1, 1, 1)), (0, (5, 1, 1, 1, 1, 1)), (0, (12, 1))),
}
MARKS = {"original": "o^D<*", "nobg": "svPX>"}
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#d9dde2",
    "grid.linewidth": 0.6,
    "axes.edgecolor": "#5c6670",
    "legend.frameon": False,
    "figure.dpi": 100,
    "pdf.fonttype": 42,
    "text.parse_math": False,  # names of photos may hold dollars
}
PNG_DPI = 160
FIXED, OWN = "fixed_psnr", "psnr"  # PSNR of one and the same view; of each step's own
NOISY = ("psnr", "loss")  # of one training view each, so that they jump from step to step
SHEET = 4  # captures that one figure shows side by side; more go onto further sheets
SMOOTH_SHARE = 10  # the running mean's window is the curve's length divided by this
LEGEND_MARK, LEGEND_LETTER = 0.6, 0.075  # inches: a mark with its gaps, a letter
LEGEND_WIDTH, LEGEND_HEIGHT = 1.3, 0.18  # inches that one entry takes
LEGEND_ROWS = 3  # that a figure's height has room for; it grows by more of them
TITLE_LETTERS = 24  # that stand on one line above a column


Item = TypeVar("Item")
Curves = dict[str, list[tuple[Cell, dict[str, list[float]]]]]  # by capture


@dataclass(frozen=True)
class Saved:
    """A figure on disk: ``stem`` without suffix; ``pictorial`` ones hold photos."""

    slug: str
    caption: str
    stem: Path
    pictorial: bool = False

    @property
    def png(self) -> Path:
        """The raster form."""
        return _named(self.stem, ".png")


def _named(stem: Path, suffix: str) -> Path:
    """Return the file's path; a dot in a capture's name begins no suffix."""
    return stem.with_name(stem.name + suffix)


@contextmanager
def style() -> Iterator[None]:
    """Set the look of everything drawn inside."""
    with mpl.rc_context(STYLE):
        yield


def save(
    figure: Figure,
    folder: Path,
    slug: str,
    caption: str,
    *,
    pictorial: bool = False,
    vector: bool = True,
) -> Saved:
    """Write ``slug.png`` without a date, and with ``vector`` ``slug.pdf``."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / slug
    if vector:
        figure.savefig(_named(stem, ".pdf"), metadata={"CreationDate": None})
    effort = {"compress_level": 1} if pictorial else {}  # photos: half the time, 8 % more bytes
    figure.savefig(
        _named(stem, ".png"), dpi=PNG_DPI, metadata={"Software": None}, pil_kwargs=effort
    )
    return Saved(slug, caption, stem, pictorial)


def colours(rows: Sequence[Row]) -> dict[str, str]:
    """Give each method its colour; 3DGS, Ours and Ours+ keep theirs, and share them with none."""
    others = sorted({row["method"] for row in rows} - set(OWN_COLOUR))
    own = dict(zip(OWN_COLOUR, PALETTE, strict=False))
    return own | dict(zip(others, cycle(PALETTE[len(own) :]), strict=False))


def dashes_of(background: str, method: str, tones: Mapping[str, str]) -> Dash:
    """Return a method's line: of those with one colour, each has its own."""
    return DASHES[background][_round(method, tones) % len(DASHES[background])]


def mark_of(background: str, method: str, tones: Mapping[str, str]) -> str:
    """Return a method's mark: of those with one colour, each has its own."""
    return MARKS[background][_round(method, tones) % len(MARKS[background])]


def _round(method: str, tones: Mapping[str, str]) -> int:
    """Return how many methods before this one have its colour."""
    before = list(tones)[: list(tones).index(method)]
    return sum(tones[one] == tones[method] for one in before)


def headed(axes: Axes, name: str) -> None:
    """Write a column's name above it, on several lines where it is long."""
    axes.set_title(textwrap.fill(name, TITLE_LETTERS))


def mean(cell: Cell, metric: str) -> float | None:
    """Return the mean of a run's metric over a cell's seeds; None where no seed has it."""
    values = [
        row["metrics"][metric] for row in cell.finished if row["metrics"].get(metric) is not None
    ]
    return sum(values) / len(values) if values else None


def less(cell: Cell, metric: str) -> float | None:
    """Return a mean of which less is better, negative, so that more is."""
    found = mean(cell, metric)
    return None if found is None else -found


def sheets(items: Sequence[Item]) -> list[tuple[str, str, Sequence[Item]]]:
    """Split what a figure shows into even sheets.

    Returns for each the ending of its slug, that of its caption, and its items.
    """
    count = -(-len(items) // SHEET)
    bounds = [round(len(items) * part / count) for part in range(count + 1)] if count else [0]
    return [
        (f"-{number}" if number > 1 else "", f" Sheet {number} of {count}." * (count > 1), part)
        for number, part in enumerate((items[a:b] for a, b in pairwise(bounds)), start=1)
    ]


def legend(figure: Figure, handles: Sequence[Line2D]) -> None:
    """Lay out the axes above a legend at the bottom edge, whose rows the figure grows by."""
    labels = [str(handle.get_label()) for handle in handles]
    longest = max(map(len, labels), default=0)
    width = max(LEGEND_WIDTH, LEGEND_MARK + LEGEND_LETTER * longest)
    across = max(1, min(len(handles), int(figure.get_figwidth() / width)))
    figure.set_figwidth(max(figure.get_figwidth(), width))  # of a long name in a narrow figure
    rows = -(-len(handles) // across)
    more = max(0, rows - LEGEND_ROWS) * LEGEND_HEIGHT
    figure.set_figheight(figure.get_figheight() + more)
    bottom = (0.08 + LEGEND_HEIGHT * rows) / figure.get_figheight()
    figure.tight_layout(rect=(0, bottom, 1, 1))
    figure.legend(handles, labels, loc="lower center", ncols=across, borderaxespad=0.2)


def training_curves(rows: Sequence[Row], root: Path | None, folder: Path) -> list[Saved]:
    """PSNR, loss and number of splats over training, per capture; the lowest seed of each cell."""
    found: Curves = {}
    for cell in cells(rows):
        train = artifact(cell.finished[0], "train", root) if cell.finished else None
        if train is not None and (train / "curve.csv").is_file():
            found.setdefault(cell.key.capture, []).append((cell, read_curve(train / "curve.csv")))
    tones = colours(rows)
    return [
        _curves({name: found[name] for name in part}, tones, folder, slug, sheet)
        for slug, sheet, part in sheets(list(found))
    ]


def _curves(found: Curves, tones: dict[str, str], folder: Path, slug: str, sheet: str) -> Saved:
    fixed = all(FIXED in curve for curves in found.values() for _, curve in curves)
    quality = (FIXED, "PSNR, one view (dB)") if fixed else (OWN, "PSNR, training view (dB)")
    shown = (quality, ("loss", "Loss"), ("splats", "Splats"))
    figure = Figure(figsize=(max(2.5 * len(found), 3.2) + 0.5, 6.2))
    grid = figure.subplots(len(shown), len(found), squeeze=False, sharex="col")
    for place, (capture, curves) in enumerate(found.items()):
        headed(grid[0][place], capture_name(capture))
        for level, (key, label) in enumerate(shown):
            axes = grid[level][place]
            for cell, curve in curves:
                if key not in curve:
                    continue
                tone = tones[cell.key.method]
                if key in NOISY:
                    axes.plot(curve["step"], curve[key], color=tone, linewidth=0.4, alpha=0.3)
                axes.plot(
                    curve["step"],
                    smooth(curve[key]) if key in NOISY else curve[key],
                    color=tone,
                    linestyle=dashes_of(cell.key.background, cell.key.method, tones),
                    linewidth=1.3,
                    label=condition_name(cell.key.background, cell.key.method),
                )
            if place == 0:
                axes.set_ylabel(label)
        grid[1][place].set_yscale("log")
        plain_numbers(grid[1][place].yaxis)
        grid[2][place].yaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
        grid[-1][place].xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
        grid[-1][place].set_xlabel("Iteration")
    lines = {str(h.get_label()): h for axes in grid[-1] for h in axes.get_lines()}
    legend(figure, list(lines.values()))
    what = (
        "PSNR is of the middle training view throughout, loss of"
        if fixed
        else "PSNR and loss are of"
    )
    selected = [cell for curves in found.values() for cell, _ in curves]
    caption = (
        findings.winners(
            selected, list(found), "Fewest splats", lambda cell: less(cell, "splats"), "count"
        )
        + f"Training curves; {what} each step's own view, thin as recorded, thick as a running "
        f"mean. {_comparing(dict.fromkeys(cell.key.method for cell in selected))}{sheet}"
    )
    return save(figure, folder, f"figure-curves{slug}", caption)


def _comparing(methods: Iterable[str]) -> str:
    """Say whose losses are weighted, and so on a scale of their own."""
    methods = list(methods)
    known = [method for method in methods if method in METHODS]
    weighted = [method_name(one) for one in known if METHODS[one].weighting != "none"]
    if len(known) < len(methods):
        weighted.append("methods of the benchmark's own that weight it")
    if not weighted:
        return "Loss and PSNR compare on one background."
    return (
        f"The loss of {joined(weighted)} is on a weighted scale and does not compare with that "
        "of others; PSNR does, on one background."
    )


def smooth(values: Sequence[float]) -> NDArray[np.float64]:
    """Return the running mean over a tenth of the curve, shorter windows at its ends."""
    array = np.asarray(values, dtype=np.float64)
    half = len(array) // (2 * SMOOTH_SHARE)
    windows = [array[max(0, i - half) : i + half + 1] for i in range(len(array))]
    return np.array([np.nanmean(w) if np.isfinite(w).any() else np.nan for w in windows])


def read_curve(path: Path) -> dict[str, list[float]]:
    """Read ``curve.csv``: columns by name; empty fields become NaN."""
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    names = list(lines[0]) if lines else []
    return {name: [float(line[name] or "nan") for line in lines] for name in names}
