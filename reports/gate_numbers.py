"""One number of one cell: its values before and after, and the interval of its change."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, median
from typing import Any

from reports import speed, statistics
from reports.rows import CellKey, Row
from reports.statistics import Interval
from reports.tolerances import Tolerance

SPREAD_LEAST = 4  # cells from which their spread is worth knowing
NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, normal distribution


@dataclass(frozen=True)
class Judged:
    """What is known of one number in one cell before its interval is set."""

    key: CellKey
    tolerance: Tolerance
    pairs: Mapping[tuple[str, int], tuple[float, float]]  # (view, seed): (before, after)
    before: float
    after: float


def collect(
    key: CellKey, tolerance: Tolerance, pairs: Sequence[tuple[Row, Row]]
) -> tuple[Judged | None, str]:
    """Gather one number's values, or say why there is none to judge.

    Both are empty for a number that neither side has and nobody requires.
    """
    values: dict[tuple[str, int], tuple[float, float]] = {}
    for after, before in pairs:
        seed = int(after["seed"])
        ours, theirs = _values(after, tolerance), _values(before, tolerance)
        if tolerance.kind == "speed":  # repeats are not paired: as many as both have
            both = ours.keys() & theirs.keys()
            ours, theirs = ({k: v[k] for k in sorted(both)} for v in (ours, theirs))
        if not ours and not theirs and not tolerance.required:
            return None, ""
        problem = _unusable(ours, theirs)
        if problem:
            return None, problem
        values |= {(name, seed): (theirs[name], ours[name]) for name in ours}
    before_mean = fmean(pair[0] for pair in values.values())
    after_mean = fmean(pair[1] for pair in values.values())
    return Judged(key, tolerance, values, before_mean, after_mean), ""


def _unusable(ours: Mapping[str, float], theirs: Mapping[str, float]) -> str:
    if not ours or not theirs:
        where = "candidate" if not ours else "baseline"
        return f"missing in the {where}" if ours or theirs else "missing in both"
    if ours.keys() != theirs.keys():
        return f"measured on other views: {', '.join(sorted(ours.keys() ^ theirs.keys())[:4])}"
    if not all(map(math.isfinite, [*ours.values(), *theirs.values()])):
        return "a value is not finite"
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
    per_seed = _by_seed(changes)
    if tolerance.kind == "exact":
        mean = fmean(changes.values())
        return Interval(mean, mean, mean, len(changes))
    repeats = 1.0 if tolerance.kind == "difference" else len(changes) / len(per_seed)
    stated = tolerance.noise * math.sqrt(2 / repeats / len(per_seed))
    run = max(
        statistics.quantile(math.inf, level) * stated,
        statistics.quantile(cells - 1, level) * among if among > 0 else 0.0,
    )
    if tolerance.kind == "difference":
        found = statistics.paired(changes, dict.fromkeys(changes, 0.0), level)
        assert found is not None  # changes hold complete pairs
        if found.mean == found.half == 0:
            return found  # the same to the bit: a deterministic run has no noise to add
        half = math.hypot(found.half, run)
        return Interval(found.mean, found.mean - half, found.mean + half, found.samples)
    mean = fmean(per_seed)
    return as_share(Interval(mean, mean - run, mean + run, len(changes)))


def spread_among(numbers: Sequence[Judged]) -> float:
    """Return the standard deviation of one metric's changes among cells, 0 for fewer than four.

    From the median absolute deviation, so that one cell that really changed does not hide itself.
    A change that all cells, all of a method, a background or a capture share is no spread either:
    of these explanations the one that leaves least counts.
    """
    if len(numbers) < SPREAD_LEAST:
        return 0.0
    means = [fmean(changes_of(number).values()) for number in numbers]
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


def _by_seed(changes: Mapping[tuple[str, int], float]) -> list[float]:
    seeds = sorted({seed for _, seed in changes})
    return [fmean(v for (_, seed), v in changes.items() if seed == one) for one in seeds]


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
