"""Quality against size and against time, one curve a method: what a budget buys.

The first thing to see of methods that were run with several numbers of splats.
"""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from reports.figures.plots import DASHES, Saved, colours, legend, save, sheets
from reports.rows import budgets, clock
from reports.rows.budgets import Point
from reports.rows.columns import signed
from reports.rows.doubts import in_doubt
from reports.rows.schema import (
    Row,
    capture_name,
    captures,
    condition_name,
    key_of,
    method_name,
    order,
)
from reports.tables.origins import machine_of

SLUG = "figure-budgets"
Curves = dict[tuple[str, str], dict[str, list[Point]]]
OVER_ALL = {"nobg": "without background", "original": "with background"}
WIDE = 30  # from here on an axis has no room for more than the powers of ten
MARKS = {"original": "o", "nobg": "s"}


def budget_curves(rows: Sequence[Row], folder: Path) -> list[Saved]:
    """Draw quality over size (upper row) and time (lower row), one column a capture.

    Nothing where no method has several budgets.
    """
    finished = [row for row in rows if row["status"] == "finished"]
    if not budgets.has_budgets(finished):
        return []
    metric, part = next(iter(budgets.parts(finished).items()))
    found = {
        cost: budgets.curves(finished, cost, metric)
        for cost in ("size_mb", clock.clock_of(finished))
    }
    tones = colours(rows)
    label = f"PSNR, {part} (dB)"
    claims = _claims(finished, metric)
    return [
        _sheet(found, list(names), label, tones, claims, folder, slug, sheet, finished)
        for slug, sheet, names in sheets(captures(finished))
    ]


def _sheet(
    found: dict[str, Curves],
    names: list[str],
    label: str,
    tones: dict[str, str],
    claims: str,
    folder: Path,
    slug: str,
    sheet: str,
    rows: Sequence[Row],
) -> Saved:
    timer = next(cost for cost in found if cost != "size_mb")
    figure = Figure(figsize=(max(2.6 * len(names), 3.4) + 0.5, 5.0))
    grid = figure.subplots(2, len(names), squeeze=False, sharey="col")
    shown: dict[tuple[str, str], None] = {}
    for place, name in enumerate(names):
        for axes, cost, text in (
            (grid[0][place], "size_mb", "Size (MB)"),
            (grid[1][place], timer, clock.AXES[timer]),
        ):
            for (capture, background), methods in found[cost].items():
                if capture == name:
                    for method, points in methods.items():
                        _curve(axes, background, points, tones[method])
                        shown[background, method] = None
            _logarithmic(axes)
            axes.set_xlabel(text)
        grid[0][place].set_title(capture_name(name))
    for axes in grid[:, 0]:
        axes.set_ylabel(label)
    legend(figure, [_handle(*condition, tones) for condition in _ordered(shown, rows)])
    mixed = len({machine_of(row) for row in rows}) > 1
    caption = (
        f"{claims}{label.removesuffix(' (dB)')}, on held-out views over file size and training "
        f"{clock.WORDS[timer]}, each on a logarithmic scale: up and to the left is better. A "
        "curve is a method with growing numbers of splats, a single point one that cannot be "
        "given any."
        f"{' Times are of different machines.' if mixed else ''}{sheet}"
    )
    return save(figure, folder, f"{SLUG}{slug}", caption)


def _curve(axes: Axes, background: str, points: Sequence[Point], tone: str) -> None:
    axes.plot(
        [cost for cost, _ in points],
        [quality for _, quality in points],
        MARKS[background],
        color=tone,
        linestyle=DASHES[background],
        linewidth=1.3,
        markersize=4.5,
        markerfacecolor=tone if background == "nobg" else "white",
    )


def _logarithmic(axes: Axes) -> None:
    """Scale the costs' axis, with plain numbers where there is room for them."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    steps = (1, 2, 5) if high / low < WIDE else (1,)
    ticks = [
        step * 10.0**power
        for power in range(-3, 7)
        for step in steps
        if low <= step * 10.0**power <= high
    ]
    axes.set_xticks(ticks)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.margins(0.08)


def _handle(background: str, method: str, tones: dict[str, str]) -> Line2D:
    return Line2D(
        [],
        [],
        color=tones[method],
        linestyle=DASHES[background],
        marker=MARKS[background],
        markersize=4.5,
        markerfacecolor=tones[method] if background == "nobg" else "white",
        label=condition_name(background, method),
    )


def _ordered(shown: dict[tuple[str, str], None], rows: Sequence[Row]) -> list[tuple[str, str]]:
    found = sorted(rows, key=lambda row: order(key_of(row))[3:5])
    wanted = dict.fromkeys((row["background"], row["method"]) for row in found)
    return [condition for condition in wanted if condition in shown]


def _claims(rows: Sequence[Row], metric: str) -> str:
    """Say of every method what it gains over 3DGS at equal size; empty where nothing compares.

    Captures in doubt do not count; a mean over fewer than were run says over how many it is.
    """
    doubted = in_doubt(rows)
    certain = [row for row in rows if row["capture"] not in doubted]
    found = budgets.gaps(certain, "size_mb", metric)
    sentences = []
    for background, where in OVER_ALL.items():
        texts = []
        names = dict.fromkeys(name for _, own, name in found if own == background)
        for method in names:
            gaps = [g for (_, b, n), g in found.items() if (b, n) == (background, method)]
            gain = budgets.mean_quality(gaps)
            if gain is not None:
                number = signed(gain.mean)
                some = f" ({gain.samples} of {len(gaps)})" if gain.samples < len(gaps) else ""
                texts.append(f"{method_name(method)} {number} dB{some}")
        if texts:
            sentences.append(f"{where} {', '.join(texts)}")
    base = method_name(budgets.BASE)
    return f"At equal size against {base}: {'; '.join(sentences)}. " if sentences else ""
