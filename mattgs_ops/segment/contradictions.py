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

from mattgs_ops.capture.mask_files import THRESHOLD
from mattgs_ops.capture.masks import Mask
from mattgs_ops.segment.quick_matches import Floats, Matches, Pair, shrunk

LEAST_SHARED = 0.5  # below it more points are in one mask alone than in both
FEWEST_POINTS = 30  # COLMAP's bound for placing a view: fewer say nothing of a mask, either


@dataclass(frozen=True)
class Contradictions:
    """``shared``: of the points that at least one mask of a pair holds, those that both hold.

    From 0 to 1; 1 where there are fewer than :data:`FEWEST_POINTS`. ``views`` are the indices of
    photos that contradict the others, in the order in which they were found.
    """

    shared: float
    views: tuple[int, ...]


def contradictions(matches: Mapping[Pair, Matches], masks: Sequence[Mask]) -> Contradictions:
    """Compare the photos' masks [H, W], 255 = object, at the points that two photos share."""
    small = [shrunk(mask) >= THRESHOLD for mask in masks]
    both, either = np.zeros((2, len(masks), len(masks)))
    for (first, second), matched in matches.items():
        here = _inside(small[first], matched.places[:, 0])
        there = _inside(small[second], matched.places[:, 1])
        for counts, found in ((both, here & there), (either, here | there)):
            counts[first, second] = counts[second, first] = found.sum()
    overall = float(_shares(both.sum() / 2, either.sum() / 2))  # each pair is there twice
    views: list[int] = []
    while len(views) < len(masks):
        shares = _shares(both.sum(axis=1), either.sum(axis=1))
        worst = int(shares.argmin())
        if shares[worst] >= LEAST_SHARED:
            break
        views.append(worst)
        for counts in (both, either):
            counts[worst, :] = counts[:, worst] = 0
    return Contradictions(overall, tuple(views))


def _shares(both: Floats, either: Floats) -> Floats:
    enough = either >= FEWEST_POINTS
    return np.where(enough, both / np.maximum(either, 1), 1.0)


def _inside(mask: NDArray[np.bool_], points: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return which points (x, y) [M, 2] of OpenCV's pixel grid lie in a mask [H, W]."""
    column, row = np.round(points).astype(np.int64).T
    height, width = mask.shape
    inside: NDArray[np.bool_] = mask[row.clip(0, height - 1), column.clip(0, width - 1)]
    return inside
