"""The interval of a change, in one cell and over several.

There are two intervals of a change, each at half of the chance of error, and the narrower counts.
**By its spread**: views and cells are samples of what the change does; a small spread makes the
change certain. **By noise**: views and cells are fixed, and a number moves without a cause only
when rounding differs. The baseline states the size of that noise; runs that agree to the bit have
none. So a stated noise, however large, never hides a change that its own spread shows. Between
machines it takes the place of the spread where there are too few cells.
"""

import math
from collections.abc import Sequence
from statistics import fmean, median

from reports.gate.numbers import NORMAL_MAD, Judged
from reports.gate.tolerances import Tolerance
from reports.rows import statistics
from reports.rows.statistics import Interval

SPREAD_LEAST = 4  # cells from which their spread is used


def interval_of(number: Judged, level: float, among: float = 0.0, cells: int = 0) -> Interval:
    """Return the interval of the mean change at a confidence, shares for ratios.

    ``among`` is the spread of this metric's changes among the ``cells`` of the same comparison
    (:func:`spread_among`). It counts where it is larger than the tolerance's noise.
    """
    tolerance = number.tolerance
    if tolerance.kind == "exact":
        mean, seeds = number.change, len(number.by_seed)
        half = statistics.quantile(math.inf, level) * number.noise * math.sqrt(2 / seeds)
        return Interval(mean, mean - half, mean + half, len(number.pairs))
    rounding = rounding_noise([number])
    shared = level if rounding is None else _halved(level)
    by_spread = _by_spread(number, shared, among, cells)
    enough = cells >= SPREAD_LEAST or not number.moved
    return _narrower(by_spread, rounding, shared, tolerance, spread=enough)


def _by_spread(number: Judged, level: float, among: float, cells: int) -> Interval:
    """Return the interval that views, laps and other cells give; logarithms for ratios."""
    changes, per_seed = number.changes, number.by_seed
    seeds = len(per_seed)
    stated = number.noise * math.sqrt(2 / seeds)
    measured = math.sqrt(sum(error**2 for _, error in per_seed.values())) / seeds
    run = max(
        statistics.quantile(math.inf, level) * math.hypot(stated, measured),
        statistics.quantile(cells - 1, level) * among if among > 0 else 0.0,
    )
    if number.tolerance.kind == "difference":
        if not any(changes.values()):  # to the bit: a deterministic run has no noise to add
            return Interval(0.0, 0.0, 0.0, len(changes))
        table = statistics.complete(changes)
        assert table is not None  # changes hold complete pairs
        interval = statistics.crossed(table, level)
        half = math.hypot(interval.half, run)
        return Interval(interval.mean, interval.mean - half, interval.mean + half, interval.samples)
    mean = number.change
    return Interval(mean, mean - run, mean + run, len(changes))


def rounding_noise(numbers: Sequence[Judged]) -> float | None:
    """Return the standard deviation of the mean change that rounding alone makes.

    None where the baseline states none, and for speed, which rounding does not change.
    """
    stated = numbers[0].tolerance.between
    if not stated or numbers[0].tolerance.kind == "speed":
        return None  # 0, in older baselines: of runs that were the same to the bit
    runs = [change for number in numbers for change, _ in number.by_seed.values()]
    moved = sum(change != 0 for change in runs)
    return stated * math.sqrt(2 * moved) / len(runs)


def _narrower(
    by_spread: Interval, rounding: float | None, level: float, tolerance: Tolerance, *, spread: bool
) -> Interval:
    """Return the narrower of two intervals of one mean; without ``spread`` that of the noise."""
    half = by_spread.half
    if rounding is not None:
        by_noise = statistics.quantile(math.inf, level) * rounding
        half = min(half, by_noise) if spread else by_noise
    interval = Interval(
        by_spread.mean, by_spread.mean - half, by_spread.mean + half, by_spread.samples
    )
    return interval if tolerance.kind == "difference" else as_share(interval)


def _halved(level: float) -> float:
    """Return the confidence at half of the chance of error."""
    return 1 - (1 - level) / 2


def spread_among(numbers: Sequence[Judged]) -> float:
    """Return the standard deviation of one metric's changes among cells, 0 for fewer than four.

    It comes from the median absolute deviation, so that one cell that really changed does not hide
    itself. A change that all cells share, or all of a method, a background or a capture, is no
    spread: of these four explanations the one that leaves least counts.
    """
    if len(numbers) < SPREAD_LEAST:
        return 0.0
    means = [number.change for number in numbers]
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


def interval_of_all(numbers: Sequence[Judged], level: float) -> Interval:
    """Return the interval of one metric's mean change over several cells, shares for ratios.

    Quality goes by views: a view's change, averaged over the cells that show it, is one sample, and
    captures are strata. The spread between runs is added. Speed and size go by single runs, each
    with its own error; speed adds what all runs of one gate share (``Tolerance.common``).
    """
    tolerance = numbers[0].tolerance
    rounding = rounding_noise(numbers)
    shared = level if rounding is None else _halved(level)
    normal = statistics.quantile(math.inf, shared)
    runs = [change for number in numbers for change, _ in number.by_seed.values()]
    stated = normal * tolerance.noise * math.sqrt(2 / len(runs))
    if tolerance.kind == "difference":
        if not any(any(number.changes.values()) for number in numbers):
            return Interval(0.0, 0.0, 0.0, len(runs))  # the same to the bit
        interval = statistics.stratified(_by_view(numbers), shared)
        among = spread_among(numbers)
        spread = statistics.quantile(len(numbers) - 1, shared) * among / math.sqrt(len(numbers))
        half = math.hypot(interval.half, max(stated, spread))
    else:
        interval = statistics.sample(runs, shared)
        half = math.hypot(max(interval.half, stated), normal * tolerance.common * math.sqrt(2))
    if interval.mean == interval.half == 0:
        return interval  # the same to the bit
    wider = Interval(interval.mean, interval.mean - half, interval.mean + half, interval.samples)
    enough = len(numbers) >= SPREAD_LEAST or not any(number.moved for number in numbers)
    return _narrower(wider, rounding, shared, tolerance, spread=enough)


def _by_view(numbers: Sequence[Judged]) -> list[list[float]]:
    """Return, by capture, each view's change averaged over its cells and seeds."""
    by_capture: dict[str, dict[str, list[float]]] = {}
    for number in numbers:
        views = by_capture.setdefault(number.key.capture, {})
        for (view, _), change in number.changes.items():
            views.setdefault(view, []).append(change)
    return [[fmean(changes) for changes in views.values()] for views in by_capture.values()]


def as_share(logarithms: Interval) -> Interval:
    """Turn logarithms of ratios into shares: 0.1 is 10 % better."""
    low, mean, high = (
        math.expm1(v) if v < 700 else math.inf
        for v in (logarithms.low, logarithms.mean, logarithms.high)
    )
    return Interval(mean, low, high, logarithms.samples)
