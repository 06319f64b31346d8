"""One number of one cell: its values before and after, and the interval of its change."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean, median
from typing import Any

from reports.gate import speed
from reports.gate.tolerances import Tolerance
from reports.rows import statistics
from reports.rows.schema import CellKey, Row
from reports.rows.statistics import Interval

SPREAD_LEAST = 4  # cells from which their spread is worth knowing
NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, normal distribution
MEDIAN_ERROR = NORMAL_MAD * 1.2533  # and times the median's standard error over the mean's


@dataclass(frozen=True)
class Judged:
    """What is known of one number in one cell before its interval is set."""

    key: CellKey
    tolerance: Tolerance
    pairs: Mapping[tuple[str, int], tuple[float, float]]  # (view, seed): (before, after)
    before: float
    after: float
    noise: float  # standard deviation of one run's value, see ``tolerances.py``
    known: bool = False  # measured between machines, so that no spread need stand in for it
    errors: Mapping[int, float] = field(default_factory=dict)  # seed: stated error of its change


def collect(
    key: CellKey, tolerance: Tolerance, pairs: Sequence[tuple[Row, Row]]
) -> tuple[Judged | None, str]:
    """Gather one number's values, or say why there is none to judge.

    Both are empty for a number that neither side has and nobody requires.
    """
    values: dict[tuple[str, int], tuple[float, float]] = {}
    errors: dict[int, float] = {}
    for after, before in pairs:
        seed = int(after["seed"])
        ours, theirs = _values(after, tolerance), _values(before, tolerance)
        if tolerance.kind == "speed":  # lap by lap, as many as both have
            stated = (speed.noise(row, tolerance.metric) for row in (after, before))
            errors[seed] = math.hypot(*stated)
            both = ours.keys() & theirs.keys()
            ours, theirs = ({k: v[k] for k in sorted(both)} for v in (ours, theirs))
        if not ours and not theirs and not tolerance.required:
            return None, ""
        problem = _unusable(tolerance, ours, theirs)
        if problem:
            return None, problem
        values |= {(name, seed): (theirs[name], ours[name]) for name in ours}
    before_mean = fmean(pair[0] for pair in values.values())
    after_mean = fmean(pair[1] for pair in values.values())
    moved = any(speed.rounds_otherwise(*pair) for pair in pairs)
    noise = _noise(tolerance, [before for _, before in pairs], moved=moved)
    known = moved and tolerance.between is not None
    return Judged(key, tolerance, values, before_mean, after_mean, noise, known, errors), ""


def _noise(tolerance: Tolerance, baseline: Sequence[Row], *, moved: bool) -> float:
    """Return the standard deviation of one run's value: of this machine, or between machines.

    Where nobody measured how many views other machines register, each view counts as a draw with
    the baseline's share (one more success and one more failure: Laplace's rule of succession).
    """
    if not moved:
        return tolerance.noise
    if tolerance.between is not None:
        return tolerance.between
    if tolerance.metric != "registered":
        return tolerance.noise
    found = [row.get("registration") or {} for row in baseline]
    views = fmean(float(one.get("views") or one["registered"]) for one in found)
    share = (fmean(float(one["registered"]) for one in found) + 1) / (views + 2)
    return math.sqrt(views * share * max(0.0, 1 - share))


def _unusable(tolerance: Tolerance, ours: Mapping[str, float], theirs: Mapping[str, float]) -> str:
    if not ours or not theirs:
        where = "candidate" if not ours else "baseline"
        return f"missing in the {where}" if ours or theirs else "missing in both"
    if ours.keys() != theirs.keys():
        return f"measured on other views: {', '.join(sorted(ours.keys() ^ theirs.keys())[:4])}"
    if not all(map(math.isfinite, [*ours.values(), *theirs.values()])):
        return "a value is not finite"
    if tolerance.kind in ("ratio", "speed"):
        for side, found in (("candidate", ours), ("baseline", theirs)):
            low = min(found.values())
            if low <= 0:
                return f"the {side} has {low:g}: expected more than 0"
    return ""


def _values(row: Row, tolerance: Tolerance) -> dict[str, float]:
    """Return one row's values of a metric by view; a single one is called ``all``."""
    if tolerance.kind == "difference":
        held_out = [view for view in row["per_view"] if view["split"] == "test"]
        found = {str(view["view"]): view.get(tolerance.metric) for view in held_out}
        return {name: float(value) for name, value in found.items() if value is not None}
    if tolerance.kind == "speed":
        return speed.calibrated(row, tolerance.metric)
    value = _single(row, tolerance.metric)
    return {} if value is None else {"all": float(value)}


def _single(row: Row, metric: str) -> Any:
    if metric == "registered":
        return (row.get("registration") or {}).get("registered")
    if metric == "mean_iou":
        return (row.get("masks") or {}).get("mean_iou")
    return row["metrics"].get(metric)


def changes_of(number: Judged) -> dict[tuple[str, int], float]:
    """Signed changes by view and seed, positive is better; logarithms for ratios."""
    sign = number.tolerance.direction
    if number.tolerance.kind in ("difference", "exact"):
        return {key: sign * (after - before) for key, (before, after) in number.pairs.items()}
    return {key: sign * math.log(after / before) for key, (before, after) in number.pairs.items()}


def interval_of(number: Judged, level: float, among: float = 0.0, cells: int = 0) -> Interval:
    """Return the interval of the mean change at a confidence, shares for ratios.

    ``among`` is the spread of this metric's changes among the ``cells`` of the same comparison
    (:func:`spread_among`): where runs differ by more than the tolerance's noise, that is seen
    there, and believed.
    """
    changes = changes_of(number)
    tolerance = number.tolerance
    per_seed = by_seed(number)
    seeds = len(per_seed)
    stated = number.noise * math.sqrt(2 / seeds)
    if tolerance.kind == "exact":
        mean = fmean(changes.values())
        half = statistics.quantile(math.inf, level) * stated
        return Interval(mean, mean - half, mean + half, len(changes))
    measured = math.sqrt(sum(error**2 for _, error in per_seed.values())) / seeds
    run = max(
        statistics.quantile(math.inf, level) * math.hypot(stated, measured),
        statistics.quantile(cells - 1, level) * among if among > 0 else 0.0,
    )
    if tolerance.kind == "difference":
        found = statistics.paired(changes, dict.fromkeys(changes, 0.0), level)
        assert found is not None  # changes hold complete pairs
        if found.mean == found.half == 0:
            return found  # the same to the bit: a deterministic run has no noise to add
        half = math.hypot(found.half, run)
        return Interval(found.mean, found.mean - half, found.mean + half, found.samples)
    mean = change_of(number)
    return as_share(Interval(mean, mean - run, mean + run, len(changes)))


def spread_among(numbers: Sequence[Judged]) -> float:
    """Return the standard deviation of one metric's changes among cells, 0 for fewer than four.

    It stands in for a noise that nobody measured; where the noise between machines is known, that
    counts.
    From the median absolute deviation, so that one cell that really changed does not hide itself.
    A change that all cells, all of a method, a background or a capture share is no spread either:
    of these explanations the one that leaves least counts.
    """
    numbers = [number for number in numbers if not number.known]
    if len(numbers) < SPREAD_LEAST:
        return 0.0
    means = [change_of(number) for number in numbers]
    explained = (
        [None for _ in numbers],
        [number.key.method for number in numbers],
        [number.key.background for number in numbers],
        [number.key.capture for number in numbers],
    )
    return min(_left_over(means, labels) for labels in explained)


def _left_over(means: Sequence[float], labels: Sequence[str | None]) -> float:
    groups: dict[str | None, list[float]] = {label: [] for label in labels}
    for mean, label in zip(means, labels, strict=True):
        groups[label].append(mean)
    rest = [abs(mean - median(groups[label])) for mean, label in zip(means, labels, strict=True)]
    lost = len(means) / max(1, len(means) - len(groups))  # each group's median took a freedom
    return NORMAL_MAD * math.sqrt(lost) * median(rest)


def by_seed(number: Judged) -> dict[int, tuple[float, float]]:
    """Return each seed's change and the error of it that its own measurements show.

    Of speeds the median over repeats counts: what disturbs a machine disturbs single repeats. Its
    error is the median absolute deviation's, or what the rows state where there is one repeat.
    """
    found: dict[int, list[float]] = {}
    for (_, seed), change in changes_of(number).items():
        found.setdefault(seed, []).append(change)
    if number.tolerance.kind != "speed":
        return {seed: (fmean(values), 0.0) for seed, values in found.items()}
    out = {}
    for seed, values in found.items():
        centre = median(values)
        spread = median(abs(value - centre) for value in values)
        own = MEDIAN_ERROR * spread / math.sqrt(len(values))
        out[seed] = centre, math.hypot(own, number.errors.get(seed, 0.0))
    return out


def change_of(number: Judged) -> float:
    """Return the mean change over seeds, positive is better; a logarithm for ratios."""
    return fmean(change for change, _ in by_seed(number).values())


def interval_of_all(numbers: Sequence[Judged], level: float) -> Interval:
    """Return the interval of one metric's mean change over all cells, shares for ratios.

    Quality goes by views: a view's change, averaged over the cells that show it, is one sample, and
    captures are strata. To that comes what whole runs differ by. Speed and size go by single runs,
    whose errors are their own; speed adds what all runs of one gate share (``Tolerance.common``).
    """
    tolerance = numbers[0].tolerance
    normal = statistics.quantile(math.inf, level)
    runs = [change for number in numbers for change, _ in by_seed(number).values()]
    squares = sum(2 * number.noise**2 * len(by_seed(number)) for number in numbers)
    stated = normal * math.sqrt(squares) / len(runs)
    if tolerance.kind == "difference":
        found = statistics.stratified(_by_view(numbers), level)
        among = spread_among(numbers)
        seen = statistics.quantile(len(numbers) - 1, level) * among / math.sqrt(len(numbers))
        half = math.hypot(found.half, max(stated, seen))
    else:
        found = statistics.sample(runs, level)
        half = math.hypot(max(found.half, stated), normal * tolerance.common * math.sqrt(2))
    if found.mean == found.half == 0:
        return found  # the same to the bit
    interval = Interval(found.mean, found.mean - half, found.mean + half, found.samples)
    return interval if tolerance.kind == "difference" else as_share(interval)


def _by_view(numbers: Sequence[Judged]) -> list[list[float]]:
    """Return, by capture, each view's change averaged over its cells and seeds."""
    found: dict[str, dict[str, list[float]]] = {}
    for number in numbers:
        views = found.setdefault(number.key.capture, {})
        for (view, _), change in changes_of(number).items():
            views.setdefault(view, []).append(change)
    return [[fmean(changes) for changes in views.values()] for views in found.values()]


def as_share(found: Interval) -> Interval:
    """Turn logarithms of ratios into shares: 0.1 is 10 % better."""
    low, mean, high = (
        math.expm1(v) if v < 700 else math.inf for v in (found.low, found.mean, found.high)
    )
    return Interval(mean, low, high, found.samples)


def worst_view(number: Judged) -> str | None:
    """Return the view that lost most, for numbers that are measured per view."""
    if number.tolerance.kind != "difference":
        return None
    changes = changes_of(number)
    return min(changes, key=lambda key: changes[key])[0]
