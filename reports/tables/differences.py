"""Every method against a base on the same capture and background: what it gains, what it costs.

Quality is the mean of the differences paired by view and seed, with its 95 % interval
(:mod:`reports.rows.statistics`); where a view is an outlier, the median over views stands beside.
Cost is a ratio of means. The last groups are means over captures, whose interval is over captures
alone: two backgrounds of one capture are not two samples. (Rows of protocol 1 keep the mean over
pairs of capture and background that their reports were printed with.) With methods that switch one
part on or leave one out, this is the table of an ablation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import geometric_mean, median

import numpy as np

from reports.rows import statistics
from reports.rows.columns import signed
from reports.rows.doubts import doubted_note, in_doubt
from reports.rows.schema import (
    BACKGROUNDS,
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
from reports.tables.notes import parts_known
from reports.tables.pairs import BASE, CONTROL, ratio, view_scores
from reports.tables.tables import HOLE

BEST = "ours+"
QUALITY = {  # metric: heading, decimals
    "mask_psnr": ("PSNR in mask, dB", 2),
    "core_psnr": ("PSNR in core, dB", 2),
    "rim_psnr": ("PSNR on rim, dB", 2),
    "core_ssim": ("SSIM in core", 4),
    "mask_ssim": ("SSIM in mask", 4),
    "detail_psnr": ("PSNR small parts, dB", 2),
    "psnr": ("PSNR, dB", 2),
}
PARTS = ("core_psnr", "rim_psnr", "core_ssim")  # of protocol 2, where the core's is the SSIM
COST = {"size_mb": "Size ×", "fps": "FPS ×", "time": "Time ×", "time_cpu": "CPU time ×"}


@dataclass(frozen=True)
class Difference:
    """A paired difference; ``median`` over views is None where no view is an outlier."""

    interval: Interval
    median: float | None = None


Number = Difference | float | None
Numbers = Mapping[str, Number]
PAIRED = (
    "Differences of held-out scores, paired by view and seed: mean ± half of the 95 % interval; "
    "bold where the interval excludes zero. Size, FPS and times are ratios of means; where other "
    "work ran beside the trainings, trust the CPU time."
)
OVERALL = "The mean over all weighs each capture and background once; its interval is over those."
OVER_CAPTURES = (
    "Means over captures weigh each capture once, and so do their intervals: captures are the "
    "samples, not their backgrounds, views or seeds. The median over views stands where a view is "
    f"an outlier: its difference is more than {statistics.OUTLYING} median absolute deviations, "
    "scaled to a normal deviation, from it (Iglewicz and Hoaglin 1993)."
)
SLUGS = {BASE: "table-differences", CONTROL: "table-differences-tuned"}


def difference_tables(rows: Sequence[Row]) -> list[Table]:
    """Return the tables against 3DGS, the tuned 3DGS and, where variants were run, Ours+."""
    selected = [cell for cell in cells(rows) if cell.finished]
    methods = {cell.key.method for cell in selected}
    bases = [BASE, CONTROL, *([BEST] if methods - set(METHOD_ORDER) else [])]
    tables = [_against(base, selected) for base in bases if base in methods and len(methods) > 1]
    return [table for table in tables if table is not None]


def _against(base: str, selected: Sequence[Cell]) -> Table | None:
    metrics = _metrics_of(selected)
    groups: list[Group] = []
    by_method: dict[str, dict[tuple[str, str], Numbers]] = {}
    places = dict.fromkeys((cell.key.capture, cell.key.background) for cell in selected)
    for capture, background in places:
        here = [c for c in selected if (c.key.capture, c.key.background) == (capture, background)]
        reference = next((c for c in here if c.key.method == base), None)
        if reference is None:
            continue
        lines = []
        for cell in here:
            if cell is reference or (base == CONTROL and cell.key.method == BASE):
                continue
            numbers = _numbers(cell, reference, metrics)
            by_method.setdefault(cell.key.method, {})[capture, background] = numbers
            runs = tuple(str(row["run_id"]) for row in cell.rows if row.get("run_id"))
            lines.append(Line(method_name(cell.key.method), _entries(numbers), runs))
        if lines:
            label = f"{capture_name(capture)}, {background_name(background)}"
            groups.append(Group(label, tuple(lines)))
    if not groups:
        return None
    second = parts_known([row for cell in selected for row in cell.finished])
    doubted = in_doubt([row for cell in selected for row in cell.rows])
    certain = {
        method: {place: numbers for place, numbers in pairs.items() if place[0] not in doubted}
        for method, pairs in by_method.items()
    }
    groups += _over_captures(certain) if second else _over_pairs(certain)
    heads = tuple(QUALITY[metric][0] for metric in metrics) + tuple(COST.values())
    slug = SLUGS.get(base, "table-differences-best")
    notes = (PAIRED, OVER_CAPTURES if second else OVERALL, *doubted_note(doubted))
    return Table(
        slug,
        f"Against {method_name(base)}",
        heads,
        (*metrics, *COST),
        tuple(groups),
        notes,
        with_runs=False,  # wide as it is; the other tables and the CSV name them
    )


def _metrics_of(selected: Sequence[Cell]) -> tuple[str, ...]:
    """Return the metrics of quality that the rows' protocol has."""
    second = parts_known([row for cell in selected for row in cell.finished])
    left_out = ("mask_ssim",) if second else PARTS
    return tuple(metric for metric in QUALITY if metric not in left_out)


def _numbers(cell: Cell, base: Cell, metrics: Sequence[str]) -> Numbers:
    quality = {metric: _difference(cell, base, metric) for metric in metrics}
    return quality | {metric: ratio(cell, base, metric) for metric in COST}


def _difference(cell: Cell, base: Cell, metric: str) -> Difference | None:
    ours, theirs = view_scores(cell, metric), view_scores(base, metric)
    interval = statistics.paired(ours, theirs)
    if interval is None:
        return None
    by_view = statistics.by_view(ours, theirs)
    if not parts_known(cell.finished) or not statistics.outliers(by_view):
        return Difference(interval)
    return Difference(interval, median(by_view.values()))


def _over_pairs(by_method: Mapping[str, Mapping[tuple[str, str], Numbers]]) -> list[Group]:
    """Return the means over pairs of capture and background, as protocol 1 had them."""
    lines = [
        Line(method_name(method), _entries(_mean(list(pairs.values()))))
        for method, pairs in by_method.items()
        if len(pairs) > 1
    ]
    return [Group("Mean over all", tuple(lines))] if lines else []


def _over_captures(by_method: Mapping[str, Mapping[tuple[str, str], Numbers]]) -> list[Group]:
    """Return the means over captures: of each background, and of both where there are two."""
    groups = []
    for background in (*BACKGROUNDS, None):
        lines = []
        for method, pairs in by_method.items():
            own: dict[str, list[Numbers]] = {}
            for (capture, where), numbers in pairs.items():
                if background in (where, None):
                    own.setdefault(capture, []).append(numbers)
            both = any(len(numbers) > 1 for numbers in own.values())
            if len(own) > 1 and (both or background is not None):
                mean = _mean([_mean(numbers) for numbers in own.values()])
                lines.append(Line(method_name(method), _entries(mean)))
        if lines:
            where = "both" if background is None else background_name(background)
            groups.append(Group(f"Mean over captures, {where}", tuple(lines)))
    return groups


def _mean(numbers: Sequence[Numbers]) -> Numbers:
    """Return the mean of several: of differences with an interval, of ratios geometrically."""
    means: dict[str, Number] = {}
    for metric in numbers[0]:
        measured = [value for one in numbers if (value := one[metric]) is not None]
        values = [v.interval.mean if isinstance(v, Difference) else v for v in measured]
        if not values:
            means[metric] = None
        elif metric in QUALITY:
            means[metric] = Difference(statistics.sample(np.array(values)))
        else:
            means[metric] = geometric_mean(values)
    return means


def _entries(numbers: Numbers) -> tuple[Entry, ...]:
    out = []
    for metric, number in numbers.items():
        if number is None:
            out.append(HOLE)
        elif isinstance(number, Difference):
            out.append(_difference_entry(number, QUALITY[metric][1]))
        else:
            out.append(Entry(f"{number:.2f}", value=number))
    return tuple(out)


def _difference_entry(difference: Difference, decimals: int) -> Entry:
    interval = difference.interval
    finite = np.isfinite(interval.half)
    middle = difference.median
    return Entry(
        signed(interval.mean, decimals),
        f"{interval.half:.{decimals}f}" if finite else "",
        bool(finite and interval.excludes_zero()),
        interval.mean,
        aside="" if middle is None else f"median {signed(middle, decimals)}",
        low=interval.low if finite else None,
        high=interval.high if finite else None,
        median=middle,
    )
