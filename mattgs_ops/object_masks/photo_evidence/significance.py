"""What views show *surely*: more than chance would let a few views show.

``surely_larger`` compares two numbers of each view, ``lowest_expected`` says what further views
like those at hand may still have. Both leave :data:`CHANCE` for being wrong.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtr, stdtrit  # scipy.stats would take a second to import

CHANCE = 0.025  # that one seems larger and is not: half of what an interval of 95 % leaves out


def surely_larger(first: Sequence[float], second: Sequence[float]) -> bool:
    """Whether the first numbers of V views are larger than the second: shares on edges, or IoU.

    A paired t-test over the views; by chance it is true once in forty times, and never where there
    is nothing to choose.
    """
    differences = np.subtract(first, second)
    count = len(differences)
    if count < 2:
        return False
    if np.ptp(differences) == 0:  # no spread to compare a difference with
        return bool(differences[0] > 0)
    error = np.std(differences, ddof=1) / np.sqrt(count)
    return bool(stdtr(count - 1, -np.mean(differences) / error) < CHANCE)


def lowest_expected(numbers: Sequence[float], more: int) -> float:
    """Return the lower end of the range in which ``more`` further numbers like these lie.

    The prediction interval of normal numbers with unknown mean and spread, mean - t s √(1 + 1/n);
    all of them together are below it by chance once in forty times (Bonferroni). Minus infinity
    where fewer than two numbers, or no further ones, are at hand.
    """
    count = len(numbers)
    if count < 2 or more < 1:
        return -np.inf
    quantile = stdtrit(count - 1, 1 - CHANCE / more)
    wide = quantile * np.std(numbers, ddof=1) * np.sqrt(1 + 1 / count)
    return float(np.mean(numbers) - wide)
