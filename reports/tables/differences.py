"""Every method against a base on the same capture and background: what it gains, what it costs.

Quality is the mean of the differences paired by view and seed, with its 95 % interval
(:mod:`reports.rows.statistics`); cost is a ratio of means. The last group is the mean over all
captures and backgrounds, its interval over those pairs alone. With methods that switch one part on
or leave one out, this is the table of an ablation.
"""

from collections.abc import Mapping, Sequence
from statistics import geometric_mean

import numpy as np

from reports.rows import statistics
from reports.rows.schema import (
    METHOD_ORDER,
    Cell,
    Row,
    background_name,
    capture_name,
    cells,
    method_name,
)
from reports.rows.statistics import Interval
from reports.tables.formats import Entry, Group, Line, Table
from reports.tables.pairs import ratio, view_scores
from reports.tables.tables import HOLE

BASE, BEST = "3dgs", "ours+"
QUALITY = {  # metric: heading, decimals
    "mask_psnr": ("PSNR in mask, dB", 2),
    "mask_ssim": ("SSIM in mask", 4),
    "detail_psnr": ("PSNR small parts, dB", 2),
    "psnr": ("PSNR, dB", 2),
}
COST = {"size_mb": "Size ×", "fps": "FPS ×", "time": "Time ×", "time_cpu": "CPU time ×"}
Numbers = Mapping[str, Interval | float | None]
PAIRED = (
    "Differences of held-out scores, paired by view and seed: mean ± half of the 95 % interval; "
    "bold where the interval excludes zero. Size, FPS and times are ratios of means; where other "
    "work ran beside the trainings, trust the CPU time."
)
OVERALL = "The mean over all weighs each capture and background once; its interval is over those."


def difference_tables(rows: Sequence[Row]) -> list[Table]:
    """Return the table against 3DGS and, where variants were run, the one against Ours+."""
    selected = [cell for cell in cells(rows) if cell.finished]
    methods = {cell.key.method for cell in selected}
    bases = [BASE, BEST] if methods - set(METHOD_ORDER) else [BASE]
    found = [_against(base, selected) for base in bases if base in methods and len(methods) > 1]
    return [table for table in found if table is not None]


def _against(base: str, selected: Sequence[Cell]) -> Table | None:
    groups: list[Group] = []
    by_method: dict[str, list[Numbers]] = {}
    places = dict.fromkeys((cell.key.capture, cell.key.background) for cell in selected)
    for capture, background in places:
        here = [c for c in selected if (c.key.capture, c.key.background) == (capture, background)]
        reference = next((c for c in here if c.key.method == base), None)
        if reference is None:
            continue
        lines = []
        for cell in here:
            if cell is reference:
                continue
            numbers = _numbers(cell, reference)
            by_method.setdefault(cell.key.method, []).append(numbers)
            runs = tuple(str(row["run_id"]) for row in cell.rows if row.get("run_id"))
            lines.append(Line(method_name(cell.key.method), _entries(numbers), runs))
        if lines:
            label = f"{capture_name(capture)}, {background_name(background)}"
            groups.append(Group(label, tuple(lines)))
    if not groups:
        return None
    lines = [
        Line(method_name(method), _entries(_mean(found)))
        for method, found in by_method.items()
        if len(found) > 1
    ]
    if lines:
        groups.append(Group("Mean over all", tuple(lines)))
    heads = tuple(heading for heading, _ in QUALITY.values()) + tuple(COST.values())
    name = method_name(base)
    slug = "table-differences" if base == BASE else "table-differences-best"
    return Table(
        slug, f"Against {name}", heads, (*QUALITY, *COST), tuple(groups), (PAIRED, OVERALL)
    )


def _numbers(cell: Cell, base: Cell) -> Numbers:
    quality = {
        metric: statistics.paired(view_scores(cell, metric), view_scores(base, metric))
        for metric in QUALITY
    }
    return quality | {metric: ratio(cell, base, metric) for metric in COST}


def _mean(found: Sequence[Numbers]) -> Numbers:
    """Return the mean over pairs: of differences with an interval, of ratios geometrically."""
    means: dict[str, Interval | float | None] = {}
    for metric in (*QUALITY, *COST):
        known = [value for one in found if (value := one[metric]) is not None]
        values = [value.mean if isinstance(value, Interval) else value for value in known]
        if not values:
            means[metric] = None
        elif metric in QUALITY:
            means[metric] = statistics.sample(np.array(values))
        else:
            means[metric] = geometric_mean(values)
    return means


def _entries(numbers: Numbers) -> tuple[Entry, ...]:
    out = []
    for metric, number in numbers.items():
        if number is None:
            out.append(HOLE)
        elif isinstance(number, Interval):
            decimals = QUALITY[metric][1]
            text = f"{number.mean:+.{decimals}f}".replace("-", "−")
            finite = np.isfinite(number.half)
            spread = f"{number.half:.{decimals}f}" if finite else ""
            certain = finite and number.excludes_zero()
            out.append(Entry(text, spread, bool(certain), number.mean))
        else:
            out.append(Entry(f"{number:.2f}", value=number))
    return tuple(out)
