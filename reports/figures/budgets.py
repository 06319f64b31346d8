"""Quality against size and against time, one curve a method: what a budget buys.

The first thing to see of methods that were run with several numbers of splats.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from reports.figures.plots import (
    Saved,
    colours,
    dashes_of,
    headed,
    legend,
    mark_of,
    save,
    sheets,
)
from reports.figures.scales import plain_numbers
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
SIZE, MIXED = "size_mb", " Times are left out: they are of different machines."


def budget_curves(rows: Sequence[Row], folder: Path) -> list[Saved]:
    """Draw quality over size (upper row) and time (lower row), one column a capture.

    Nothing where no method has several budgets; no times where several machines measured them.
    """
    finished = [row for row in rows if row["status"] == "finished"]
    if not budgets.has_budgets(finished):
        return []
    metric, part = next(iter(budgets.parts(finished).items()))
    mixed = len({machine_of(row) for row in finished}) > 1
    costs = {SIZE: "Size (MB)"}
    if not mixed:
        timer = clock.clock_of(finished)
        costs[timer] = clock.AXES[timer]
    found = {cost: budgets.curves(finished, cost, metric) for cost in costs}
    tones = colours(rows)
    label = f"PSNR, {part} (dB)"
    claims = _claims(finished, metric)
    return [
        _sheet(costs, found, list(names), label, tones, claims, folder, slug, sheet, finished)
        for slug, sheet, names in sheets(captures(finished))
    ]


def _sheet(
    costs: dict[str, str],
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
    figure = Figure(figsize=(max(2.6 * len(names), 3.4) + 0.5, 0.4 + 2.3 * len(found)))
    grid = figure.subplots(len(found), len(names), squeeze=False, sharey="col")
    shown: dict[tuple[str, str], None] = {}
    for place, name in enumerate(names):
        for axes, (cost, text) in zip(grid[:, place], costs.items(), strict=True):
            for (capture, background), methods in found[cost].items():
                if capture == name:
                    for method, points in methods.items():
                        _curve(axes, points, _look(background, method, tones))
                        shown[background, method] = None
            axes.set_xscale("log")
            plain_numbers(axes.xaxis)
            axes.margins(0.08)
            axes.set_xlabel(text)
        headed(grid[0][place], capture_name(name))
    for axes in grid[:, 0]:
        axes.set_ylabel(label)
    legend(figure, [_handle(*condition, tones) for condition in _ordered(shown, rows)])
    over = " and training ".join(["file size", *(clock.WORDS[c] for c in costs if c != SIZE)])
    caption = (
        f"{claims}{label.removesuffix(' (dB)')}, on held-out views over {over}, on logarithmic "
        "scales: up and to the left is better. A curve is a method with growing numbers of splats, "
        f"a single point one that cannot be given any.{'' if len(costs) > 1 else MIXED}{sheet}"
    )
    return save(figure, folder, f"{SLUG}{slug}", caption)


def _curve(axes: Axes, points: Sequence[Point], look: dict[str, Any]) -> None:
    axes.plot([cost for cost, _ in points], [quality for _, quality in points], **look)


def _look(background: str, method: str, tones: dict[str, str]) -> dict[str, Any]:
    """Return what a condition's curve looks like, in the axes and in the legend."""
    return {
        "color": tones[method],
        "linestyle": dashes_of(background, method, tones),
        "linewidth": 1.3,
        "marker": mark_of(background, method, tones),
        "markersize": 4.5,
        "markerfacecolor": tones[method] if background == "nobg" else "white",
    }


def _handle(background: str, method: str, tones: dict[str, str]) -> Line2D:
    label = condition_name(background, method)
    return Line2D([], [], label=label, **_look(background, method, tones))


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
