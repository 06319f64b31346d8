"""Which masks contradict those of other photos, by the points that photos share.

A point that two photos show lies on the object in both or in neither. So of the matched points that
at least one of the two masks holds, both should hold most. A photo *contradicts* the others where
both masks hold fewer of its points than one mask alone. Which of two masks is the wrong one does
not follow: photos are named one by one, those that share least first, and the points of a named
photo no longer count against the rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import Mask
from mattgs_ops.capture.sparse import inside

LEAST_SHARED = 0.5  # below it more points are in one mask alone than in both
FEWEST_POINTS = 30  # COLMAP's bound for placing a view: fewer say nothing of a mask, either
MOST_VIEWS = 0.5  # of the views must have as many points, or nothing is known of the capture


@dataclass(frozen=True)
class Contradictions:
    """``shared``: of the points that at least one mask of a pair holds, those that both hold.

    From 0 to 1; None where fewer than half of the views have :data:`FEWEST_POINTS` such points.
    ``views`` are the indices of photos that contradict the others, in the order in which they were
    found.
    """

    shared: float | None
    views: tuple[int, ...]


def contradictions(
    places: Mapping[tuple[int, int], NDArray[np.float64]], masks: Sequence[Mask]
) -> Contradictions:
    """Compare masks [H, W], 0 or 255 = object, at the points that two photos share.

    ``places`` [M, 2, 2] are a pair's matched points, (x, y) in the first mask and in the second, in
    pixels of the masks; the centre of the top-left one is at (0.5, 0.5).
    """
    both, either = np.zeros((2, len(masks), len(masks)))
    for (first, second), matched in places.items():
        before = np.ones(len(matched))  # what a photo shows is before its camera
        here = inside(masks[first], matched[:, 0], before)
        there = inside(masks[second], matched[:, 1], before)
        for counts, found in ((both, here & there), (either, here | there)):
            counts[first, second] = counts[second, first] = found.sum()
    known = (either.sum(axis=1) >= FEWEST_POINTS).mean() >= MOST_VIEWS
    overall = float(both.sum() / either.sum()) if known else None
    views: list[int] = []
    while len(views) < len(masks):
        found = either.sum(axis=1)
        shares = np.where(found >= FEWEST_POINTS, both.sum(axis=1) / np.maximum(found, 1), 1.0)
        worst = int(shares.argmin())
        if shares[worst] >= LEAST_SHARED:
            break
        views.append(worst)
        for counts in (both, either):
            counts[worst, :] = counts[:, worst] = 0
    return Contradictions(overall, tuple(views))
