"""Where a noisy series of numbers changed its level for good: a piecewise constant fit.

The fit with k steps is the one with the least sum of absolute deviations from the levels' medians
(the Potts functional with an L1 data term; exact, by dynamic programming). How many steps there are
is decided by an information criterion: with Laplace noise the negative log-likelihood of n points
is n ln b + const, where b is the mean absolute deviation, and each step costs ``PENALTY`` · ln n.
``airspeed-velocity`` finds regressions by a fit of the same kind.

A level has at least ``FEWEST`` points, so that one disturbed run is no step: a step at the newest
commit is named after its second run.
"""

import math
from bisect import insort
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

FEWEST = 2  # points of a level
MOST_STEPS = 10  # that are looked for in one series
# Of one step, in units of ln n. Schwarz's criterion has 1, for the level and for the place; but the
# place is chosen among n, so that pure noise often gains as much. Short series pay as if they had
# 16 points. tests/reports/history/test_steps.py counts how often noise alone then shows a step.
PENALTY = 3.0
FEWEST_COUNTED = 16


@dataclass(frozen=True)
class Step:
    """A change of level: ``first`` is the index of the first point on the new one."""

    first: int
    before: float
    after: float

    @property
    def change(self) -> float:
        """New level minus old level."""
        return self.after - self.before


def find_steps(values: Sequence[float], *, margin: float, noise: float) -> list[Step]:
    """Return the steps of a series, in order.

    ``margin`` is the smallest change that counts, ``noise`` the smallest mean absolute deviation
    that is believed: deterministic runs repeat to the bit. Both are in the unit of ``values``, and
    more than 0.
    """
    if margin <= 0 or noise <= 0:
        raise ValueError(f"expected margin and noise above 0, found {margin} and {noise}")
    count = len(values)
    if count < 2 * FEWEST or max(values) - min(values) <= margin:
        return []
    starts = _best_starts(np.asarray(values, dtype=np.float64), noise)
    while len(starts) > 1:
        found = _steps(values, starts)
        smallest = min(found, key=lambda step: abs(step.change))
        if abs(smallest.change) > margin:
            return found
        starts.remove(smallest.first)
    return []


def _steps(values: Sequence[float], starts: Sequence[int]) -> list[Step]:
    ends = [*starts[1:], len(values)]
    levels = [median(values[a:b]) for a, b in zip(starts, ends, strict=True)]
    return [
        Step(start, before, after)
        for start, before, after in zip(starts[1:], levels, levels[1:], strict=False)
    ]


def _best_starts(values: NDArray[np.float64], noise: float) -> list[int]:
    """Return where levels begin, 0 among them, in the fit that the criterion prefers."""
    count = len(values)
    costs = deviations(values)
    least = costs[0]  # [n + 1]: of the first m points with so many steps as yet
    froms: list[NDArray[np.int64]] = []
    best, chosen = _criterion(least[count], 0, count, noise), 0
    for steps in range(1, min(MOST_STEPS, count // FEWEST - 1) + 1):
        total = least[:, None] + costs  # [begin of the last level, end]
        froms.append(np.argmin(total, axis=0))
        least = np.min(total, axis=0)
        found = _criterion(least[count], steps, count, noise)
        if found < best:
            best, chosen = found, steps
    starts, end = [], count
    for begins in reversed(froms[:chosen]):
        end = int(begins[end])
        starts.append(end)
    return [0, *reversed(starts)]


def _criterion(deviation: float, steps: int, count: int, noise: float) -> float:
    """Return what is to be least, for a sum of absolute deviations; infinite where no fit is."""
    if not math.isfinite(deviation):
        return math.inf
    penalty = PENALTY * math.log(max(count, FEWEST_COUNTED))
    return count * math.log(max(deviation / count, noise)) + penalty * steps


def deviations(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of absolute deviations from the median of ``values[a:b]`` at [a, b].

    [n + 1, n + 1], infinite where a level would have fewer than ``FEWEST`` points.
    """
    count = len(values)
    out = np.full((count + 1, count + 1), np.inf)
    for begin in range(count):
        ordered: list[float] = []
        total = 0.0
        for end in range(begin + 1, count + 1):
            total += _added(ordered, float(values[end - 1]))
            if end - begin >= FEWEST:
                out[begin, end] = total
    return out


def _added(ordered: list[float], value: float) -> float:
    """Insert a value into a sorted list; return by how much its sum of deviations grows.

    The sum is smallest anywhere between the two middle values, so a value there adds nothing, and
    one outside adds its distance from them.
    """
    size = len(ordered)
    grown = 0.0
    if size:
        low, high = ordered[(size - 1) // 2], ordered[size // 2]
        grown = max(low - value, value - high, 0.0)
    insort(ordered, value)
    return grown
