"""Methods with several numbers of splats: curves of quality over cost, and what lies between.

A curve's cost is megabytes or seconds, its quality decibels. Of two curves Bjøntegaard (2001) has
the mean ratio of cost at equal quality and the mean difference of quality at equal cost, over what
the curves share, cost on a logarithmic scale; interpolated piecewise (PCHIP), as since 2011. Only
points that bring more quality than all cheaper ones are on a curve: a method that was given room
and lost by it would not be run that way.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, isfinite, log
from statistics import fmean

from reports.rows import statistics
from reports.rows.schema import Cell, CellKey, Row, cells, key_of
from reports.rows.statistics import Interval

BASE = "3dgs"
# Metric: of what part of the picture it is, as tables and figures say it
PARTS = {
    "mask_psnr": "object",
    "core_psnr": "object's core",
    "detail_psnr": "small parts",
}
FRAME = {"psnr": "full frame"}
FEWEST_POINTS = 2  # of a curve
SHARED = 0.25  # of what both curves span: less says nothing of either
PERCENT = 100.0
Point = tuple[float, float]  # cost and quality
Place = tuple[str, str]  # capture and background
Compared = tuple[str, str, str]  # and the method


@dataclass(frozen=True)
class Gap:
    """A method against another on one capture and background; None where curves share too little.

    ``cost`` is the logarithm of its cost over the other's at equal quality, ``quality`` the
    difference in decibels at equal cost.
    """

    cost: float | None
    quality: float | None


def has_budgets(rows: Sequence[Row]) -> bool:
    """Whether some method was run with several numbers of splats."""
    known: dict[tuple[str, str, str], set[int]] = {}
    for row in rows:
        own = known.setdefault((row["capture"], row["background"], row["method"]), set())
        own.add(key_of(row).budget)
    return any(len(budgets) > 1 for budgets in known.values())


def parts(rows: Sequence[Row]) -> dict[str, str]:
    """Return the metrics that methods are compared by, with the part of the picture each is of."""
    known = {name for row in rows for name in row.get("metrics") or {}}
    return {metric: part for metric, part in PARTS.items() if metric in known} or FRAME


def largest(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of each condition's largest budget: those that one point stands for."""
    most: dict[CellKey, int] = {}
    for row in rows:
        key = _without_budget(row)
        most[key] = max(most.get(key, 0), key_of(row).budget)
    return [row for row in rows if key_of(row).budget == most[_without_budget(row)]]


def _without_budget(row: Row) -> CellKey:
    key = key_of(row)
    return CellKey(key.capture, key.background, key.method, key.iterations, key.resolution)


def curves(rows: Sequence[Row], cost: str, quality: str) -> dict[Place, dict[str, list[Point]]]:
    """Return each method's points by capture and background, cheapest first; means over seeds."""
    found: dict[Place, dict[str, list[Point]]] = {}
    for cell in cells(rows):
        point = _mean(cell, cost), _mean(cell, quality)
        if point[0] is not None and point[1] is not None:
            place = found.setdefault((cell.key.capture, cell.key.background), {})
            place.setdefault(cell.key.method, []).append((point[0], point[1]))
    return {
        place: {method: sorted(points) for method, points in methods.items()}
        for place, methods in found.items()
    }


def _mean(cell: Cell, metric: str) -> float | None:
    values = [row["metrics"].get(metric) for row in cell.finished]
    known = [float(value) for value in values if value is not None]
    return fmean(known) if known else None


def front(points: Sequence[Point]) -> list[Point]:
    """Return the points that have more quality than all cheaper ones, cheapest first."""
    out: list[Point] = []
    for cost, quality in sorted(points, key=lambda point: (point[0], -point[1])):
        if not out or (quality > out[-1][1] and cost > out[-1][0]):
            out.append((cost, quality))
    return out


def gap(curve: Sequence[Point], base: Sequence[Point]) -> Gap:
    """Compare a curve, or a single point, with another curve; costs are positive."""
    one, other = front(curve), front(base)
    if len(other) < FEWEST_POINTS or not one:
        return Gap(None, None)
    if len(one) < FEWEST_POINTS:
        return _from_curve(one[0], other)
    logs = [[log(cost) for cost, _ in points] for points in (other, one)]
    decibels = [[quality for _, quality in points] for points in (other, one)]
    return Gap(_area(decibels, logs), _area(logs, decibels))


def _from_curve(point: Point, base: Sequence[Point]) -> Gap:
    """Return how far one point lies from a curve; None beyond the curve's ends."""
    along, decibels = [log(cost) for cost, _ in base], [quality for _, quality in base]
    from scipy.interpolate import PchipInterpolator  # takes a second, and few reports have budgets

    mine = log(point[0])
    cost = quality = None
    if along[0] <= mine <= along[-1]:
        quality = point[1] - float(PchipInterpolator(along, decibels)(mine))
    if decibels[0] <= point[1] <= decibels[-1]:
        cost = mine - float(PchipInterpolator(decibels, along)(point[1]))
    return Gap(cost, quality)


def _area(along: Sequence[Sequence[float]], of: Sequence[Sequence[float]]) -> float | None:
    """Return the mean difference of the second curve from the first over what they share."""
    starts, ends = zip(*((min(values), max(values)) for values in along), strict=True)
    if min(ends) - max(starts) < SHARED * (max(ends) - min(starts)):
        return None
    import bjontegaard  # matplotlib's state machine comes with it: not before it is needed

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # how much they share was looked at above
        found = bjontegaard.bd_linear(
            along[0], of[0], along[1], of[1], method="pchip", require_matching_points=False
        )
    return float(found) if isfinite(found) else None


def gaps(rows: Sequence[Row], cost: str, metric: str) -> dict[Compared, Gap]:
    """Compare every method with 3DGS: by capture, background and method."""
    return {
        (capture, background, method): gap(points, methods[BASE])
        for (capture, background), methods in curves(rows, cost, metric).items()
        for method, points in methods.items()
        if method != BASE and BASE in methods
    }


def mean_cost(found: Sequence[Gap]) -> Interval | None:
    """Return the mean over captures of the cost at equal quality, percent more; with interval."""
    known = [one.cost for one in found if one.cost is not None]
    if not known:
        return None
    mean = statistics.sample(known)
    return Interval(percent(mean.mean), percent(mean.low), percent(mean.high), mean.samples)


def mean_quality(found: Sequence[Gap]) -> Interval | None:
    """Return the mean over captures of the quality at equal cost, in decibels, with interval."""
    known = [one.quality for one in found if one.quality is not None]
    return statistics.sample(known) if known else None


def percent(ratio: float) -> float:
    """Return how much more a logarithm of a ratio is, in percent; infinite for infinity."""
    if not isfinite(ratio):
        return -PERCENT if ratio < 0 else ratio
    return (exp(ratio) - 1) * PERCENT
