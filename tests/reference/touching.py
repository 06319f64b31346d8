"""Which splats touch, and which parts they form: every pair, one at a time."""

import math

import numpy as np


def touch(means: np.ndarray, spreads: np.ndarray, reach: float) -> set[tuple[int, int]]:
    """Return all pairs (i < j) whose ellipsoids, ``reach`` deviations large, meet on the way."""
    pairs = set()
    for i in range(len(means)):
        for j in range(i + 1, len(means)):
            way = means[j] - means[i]
            length = math.sqrt(float(way @ way))
            way = way / length
            deviations = [math.sqrt(float(way @ s @ s.T @ way)) for s in (spreads[i], spreads[j])]
            if length <= reach * sum(deviations):
                pairs.add((i, j))
    return pairs


def parts(count: int, pairs: set[tuple[int, int]], among: set[int]) -> set[frozenset[int]]:
    """Return the connected parts of the splats of ``among``, by flooding."""
    left, found = set(among), set()
    while left:
        flood = [left.pop()]
        part = set(flood)
        while flood:
            here = flood.pop()
            for other in range(count):
                if other in left and (min(here, other), max(here, other)) in pairs:
                    left.remove(other)
                    part.add(other)
                    flood.append(other)
        found.add(frozenset(part))
    return found
