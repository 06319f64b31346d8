"""Intervals for paired differences and for ratios; plain numbers in, plain numbers out.

Quality is paired: the same view and the same seed under two codes or two methods, so that what a
view costs everybody cancels. Views and seeds are crossed random factors; the variance of the grand
mean comes from the two-way mean squares, its degrees of freedom from Satterthwaite (1946).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Floats = NDArray[np.float64]
CONFIDENCE = 0.95
# Iglewicz and Hoaglin 1993, How to Detect and Handle Outliers, sections 3.5 and 3.6
OUTLYING = 3.5  # modified z-score from which on a value is an outlier
FEWEST_VALUES = 5  # with fewer, half of the values are the median and one beside it
NORMAL_MAD, NORMAL_MEAN_AD = 1.4826, 1.2533  # standard deviations of a normal sample per deviation


@dataclass(frozen=True)
class Interval:
    """A mean with its confidence interval; infinite where one sample says nothing of spread."""

    mean: float
    low: float
    high: float
    samples: int

    @property
    def half(self) -> float:
        """Half the width."""
        return (self.high - self.low) / 2

    def excludes_zero(self) -> bool:
        """Whether the sign of the mean is beyond doubt at the interval's confidence."""
        return self.low > 0 or self.high < 0


def paired(
    candidate: Mapping[tuple[str, int], float],
    baseline: Mapping[tuple[str, int], float],
    confidence: float = CONFIDENCE,
) -> Interval | None:
    """Interval of ``candidate - baseline`` over keys (view, seed) that both have.

    Samples are the views of :func:`complete`; None when there are none. With one it is infinite,
    however many seeds there are: they say nothing of other views.
    """
    shared = candidate.keys() & baseline.keys()
    table = complete({key: candidate[key] - baseline[key] for key in shared})
    if table is None:
        return None
    if len(table) == 1:
        return sample([float(table.mean())], confidence)
    return replace(crossed(table, confidence), samples=len(table))


def complete(values: Mapping[tuple[str, int], float]) -> Floats | None:
    """Return values by (view, seed) as a table [views, seeds], for :func:`crossed`.

    Views that some seed lacks are left out; None when nothing is left.
    """
    seeds = sorted({seed for _, seed in values})
    views = sorted({view for view, _ in values})
    views = [view for view in views if all((view, seed) in values for seed in seeds)]
    return np.array([[values[view, seed] for seed in seeds] for view in views]) if views else None


def by_view(
    candidate: Mapping[tuple[str, int], float], baseline: Mapping[tuple[str, int], float]
) -> dict[str, float]:
    """Return ``candidate - baseline`` by view, the mean over the seeds that both have."""
    changes: dict[str, list[float]] = {}
    for view, seed in sorted(candidate.keys() & baseline.keys()):
        changes.setdefault(view, []).append(candidate[view, seed] - baseline[view, seed])
    return {view: float(np.mean(values)) for view, values in changes.items()}


def outliers(values: Mapping[str, float]) -> list[str]:
    """Return the names whose values are outliers among the others.

    A modified z-score, the distance from the median in median absolute deviations (scaled to the
    standard deviation of a normal sample), beyond :data:`OUTLYING`. Where more than half of the
    values are equal, their mean absolute deviation is the scale.
    """
    if len(values) < FEWEST_VALUES:
        return []
    numbers = np.array(list(values.values()), dtype=np.float64)
    away = np.abs(numbers - np.median(numbers))
    scale = NORMAL_MAD * float(np.median(away)) or NORMAL_MEAN_AD * float(away.mean())
    return [name for name, far in zip(values, away, strict=True) if far > OUTLYING * scale]


def crossed(table: Floats, confidence: float = CONFIDENCE) -> Interval:
    """Interval of the grand mean of ``table`` [views, seeds], both taken as random.

    With one seed (or one view) it is Student's interval over the other factor. Samples are the
    number of entries.
    """
    views, seeds = table.shape
    mean = float(table.mean())
    if min(views, seeds) == 1:
        return sample(table.ravel(), confidence)
    by_view, by_seed = table.mean(axis=1), table.mean(axis=0)
    square_view = seeds * float(((by_view - mean) ** 2).sum()) / (views - 1)
    square_seed = views * float(((by_seed - mean) ** 2).sum()) / (seeds - 1)
    rest = table - by_view[:, None] - by_seed[None, :] + mean
    free = (views - 1) * (seeds - 1)
    square_rest = float((rest**2).sum()) / free
    # never below what the views alone say: the difference of mean squares may come out negative
    total = max(square_view + square_seed - square_rest, square_view, square_rest)
    if total == 0:
        return Interval(mean, mean, mean, table.size)
    freedom = total**2 / (
        square_view**2 / (views - 1) + square_seed**2 / (seeds - 1) + square_rest**2 / free
    )
    half = quantile(freedom, confidence) * float(np.sqrt(total / table.size))
    return Interval(mean, mean - half, mean + half, table.size)


def sample(values: Sequence[float] | Floats, confidence: float = CONFIDENCE) -> Interval:
    """Return Student's interval of the mean of independent values; infinite for one value."""
    array = np.asarray(values, dtype=np.float64)
    mean = float(array.mean())
    if array.size < 2:
        return Interval(mean, -np.inf, np.inf, array.size)
    error = float(array.std(ddof=1) / np.sqrt(array.size))
    half = quantile(array.size - 1, confidence) * error
    return Interval(mean, mean - half, mean + half, array.size)


def stratified(strata: Sequence[Sequence[float]], confidence: float = CONFIDENCE) -> Interval:
    """Student's interval of the mean of all values; only what differs within a stratum is noise."""
    values = np.concatenate([np.asarray(stratum, dtype=np.float64) for stratum in strata])
    mean = float(values.mean())
    freedom = values.size - len(strata)
    if freedom < 1:
        return Interval(mean, -np.inf, np.inf, values.size)
    squares = sum(float(((s - np.mean(s)) ** 2).sum()) for s in map(np.asarray, strata))
    half = quantile(freedom, confidence) * float(np.sqrt(squares / freedom / values.size))
    return Interval(mean, mean - half, mean + half, values.size)


def quantile(freedom: float, confidence: float) -> float:
    """Return the two-sided quantile of Student's t; infinite freedom is the normal distribution."""
    return float(stdtrit(min(freedom, 1e9), 0.5 + confidence / 2))
