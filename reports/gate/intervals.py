"""The interval of a change, in one cell and over several.

A change can be seen in two ways, and the surer of two intervals counts, each at half of the chance
of error. **By its spread**: views, and cells, are samples of what the change does; where the spread
is small, the change is certain. **By known noise**: the benchmark is what it is, and its number
moves without a cause only when rounding differs, by a noise that the baseline knows; runs that came
out the same to the bit have none. So noise that is known never hides a change that its own spread
shows, however large it is. Between machines it takes the place of spread among too few cells.
"""

import math
from collections.abc import Sequence
from statistics import fmean, median

from reports.gate.numbers import NORMAL_MAD, Judged, by_seed, change_of, changes_of
from reports.gate.tolerances import Tolerance
from reports.rows import statistics
from reports.rows.statistics import Interval

SPREAD_LEAST = 4  # cells from which their spread is worth knowing


def interval_of(number: Judged, level: float, among: float = 0.0, cells: int = 0) -> Interval:
    """Return the interval of the mean change at a confidence, shares for ratios.

    ``among`` is the spread of this metric's changes among the ``cells`` of the same comparison
    (:func:`spread_among`): where runs differ by more than the tolerance's noise, that is seen
    there, and believed.
    """
    tolerance = number.tolerance
    if tolerance.kind == "exact":
        mean, seeds = change_of(number), len(by_seed(number))
        half = statistics.quantile(math.inf, level) * number.noise * math.sqrt(2 / seeds)
        return Interval(mean, mean - half, mean + half, len(number.pairs))
    rounding = rounding_noise([number])
    shared = level if rounding is None else _halved(level)
    found = _by_spread(number, shared, among, cells)
    if found.mean == found.half == 0:
        return found  # the same to the bit: a deterministic run has no noise to add
    enough = cells >= SPREAD_LEAST or not number.moved
    return _surer(found, rounding, shared, tolerance, spread=enough)


def _by_spread(number: Judged, level: float, among: float, cells: int) -> Interval:
    """Return the interval that views, laps and other cells give; logarithms for ratios."""
    changes, per_seed = changes_of(number), by_seed(number)
    seeds = len(per_seed)
    stated = number.noise * math.sqrt(2 / seeds)
    measured = math.sqrt(sum(error**2 for _, error in per_seed.values())) / seeds
    run = max(
        statistics.quantile(math.inf, level) * math.hypot(stated, measured),
        statistics.quantile(cells - 1, level) * among if among > 0 else 0.0,
    )
    if number.tolerance.kind == "difference":
        found = statistics.paired(changes, dict.fromkeys(changes, 0.0), level)
        assert found is not None  # changes hold complete pairs
        if found.mean == found.half == 0:
            return found
        half = math.hypot(found.half, run)
        return Interval(found.mean, found.mean - half, found.mean + half, found.samples)
    mean = change_of(number)
    return Interval(mean, mean - run, mean + run, len(changes))


def rounding_noise(numbers: Sequence[Judged]) -> float | None:
    """Return the standard deviation of the mean change of numbers that rounding alone makes.

    None where the baseline does not know it, and for speed, which rounding does not touch.
    """
    known = numbers[0].tolerance.between
    if known is None or numbers[0].tolerance.kind == "speed":
        return None
    runs = [change for number in numbers for change, _ in by_seed(number).values()]
    moved = sum(change != 0 for change in runs)
    return known * math.sqrt(2 * moved) / len(runs)


def _surer(
    found: Interval, rounding: float | None, level: float, tolerance: Tolerance, *, spread: bool
) -> Interval:
    """Return the narrower of two intervals of one mean; without ``spread`` the known noise's."""
    half = found.half
    if rounding is not None:
        known = statistics.quantile(math.inf, level) * rounding
        half = min(half, known) if spread else known
    interval = Interval(found.mean, found.mean - half, found.mean + half, found.samples)
    return interval if tolerance.kind == "difference" else as_share(interval)


def _halved(level: float) -> float:
    """Return the confidence at half of the chance of error."""
    return 1 - (1 - level) / 2


def spread_among(numbers: Sequence[Judged]) -> float:
    """Return the standard deviation of one metric's changes among cells, 0 for fewer than four.

    From the median absolute deviation, so that one cell that really changed does not hide itself.
    A change that all cells, all of a method, a background or a capture share is no spread either:
    of these explanations the one that leaves least counts.
    """
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


def interval_of_all(numbers: Sequence[Judged], level: float) -> Interval:
    """Return the interval of one metric's mean change over several cells, shares for ratios.

    Quality goes by views: a view's change, averaged over the cells that show it, is one sample, and
    captures are strata. To that comes what whole runs differ by. Speed and size go by single runs,
    whose errors are their own; speed adds what all runs of one gate share (``Tolerance.common``).
    """
    tolerance = numbers[0].tolerance
    rounding = rounding_noise(numbers)
    shared = level if rounding is None else _halved(level)
    normal = statistics.quantile(math.inf, shared)
    runs = [change for number in numbers for change, _ in by_seed(number).values()]
    stated = normal * tolerance.noise * math.sqrt(2 / len(runs))
    if tolerance.kind == "difference":
        found = statistics.stratified(_by_view(numbers), shared)
        among = spread_among(numbers)
        seen = statistics.quantile(len(numbers) - 1, shared) * among / math.sqrt(len(numbers))
        half = math.hypot(found.half, max(stated, seen))
    else:
        found = statistics.sample(runs, shared)
        half = math.hypot(max(found.half, stated), normal * tolerance.common * math.sqrt(2))
    if found.mean == found.half == 0:
        return found  # the same to the bit
    whole = Interval(found.mean, found.mean - half, found.mean + half, found.samples)
    enough = len(numbers) >= SPREAD_LEAST or not any(number.moved for number in numbers)
    return _surer(whole, rounding, shared, tolerance, spread=enough)


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
