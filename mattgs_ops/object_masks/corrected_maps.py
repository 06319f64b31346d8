"""A view's own map, corrected by what the other views predict of it: averages, each by its odds.

Silhouettes are coarse and know free space; votes know surfaces; the own map knows the photo. Each
weighs what the odds are that it is right, of its agreement with the views' maps.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import HALF, SoftMap, disc, parts_apart
from mattgs_ops.object_masks.silhouettes import SIDE, resized
from mattgs_ops.object_masks.splats.votes import VotedMaps

NO_COUNTS = 2.0  # times a yes, of silhouettes
COARSE = 2 / SIDE  # of the longest side: two pixels of those that silhouettes are compared at
BEST = 0.99  # agreement above it counts as this much: weights stay finite


def corrected(
    own: Sequence[SoftMap],
    others: Sequence[SoftMap],
    voted: Sequence[SoftMap],
    silhouettes: float,
    votes: float,
    along: Sequence[SoftMap],
) -> list[SoftMap]:
    """Average own map, silhouettes and votes, weighted by the odds that each is right.

    Pixels outside the other views' silhouettes cannot be object if those are right; pixels inside
    may be free space between them. So silhouettes count twice where they say no. Along the map's
    own outline they are less exact than ``along`` [H, W], which counts there.
    """
    outlines, splats = _odds(silhouettes), _odds(votes)
    itself = max(outlines, splats)  # a map weighs as much as the better of the two
    fused = []
    for mine, other, vote, exact in zip(own, others, voted, along, strict=True):
        weight = outlines * np.where(other < HALF, NO_COUNTS, 1.0)
        mean = (itself * mine + weight * other + splats * vote) / (itself + weight + splats)
        # where the mean takes a whole part away, the part's outline goes with it
        near = _near_outline(mine >= HALF) & _near_outline(mean >= HALF, 2 * COARSE)
        fused.append(np.where(near, exact, mean).astype(np.float32))
    return fused


def corrected_by_all(
    own: Sequence[SoftMap],
    others: Sequence[SoftMap],
    votes: VotedMaps,
    agreement: float,
    along: Sequence[SoftMap],
    *,
    alone: bool,
) -> list[SoftMap]:
    """Return own maps corrected by silhouettes and votes, and by ``along`` near their outlines.

    ``alone``: by nothing else, as on plain ground, where there is nothing that maps could take
    along and silhouettes could take away, and where parts that a map saw less than half of are not
    the object's: a colour chart lies in every photo. Maps that show nothing are lent the others'
    prediction.
    """
    splats_agreement = float(np.mean(votes.soft_agreement))
    predicted = resized(votes.predicted, own)
    mixed = corrected(own, others, predicted, agreement, splats_agreement, along)
    if not alone:
        return mixed
    connected = [_without_parts_apart(a, mine) for a, mine in zip(along, own, strict=True)]
    return unless([not (mine >= HALF).any() for mine in own], connected, mixed)


def _without_parts_apart(mixed: SoftMap, own: SoftMap) -> SoftMap:
    apart = parts_apart(mixed >= HALF, own >= HALF)
    return np.where(apart, np.minimum(own, mixed), mixed)


def averaged(
    own: Sequence[SoftMap], voted: Sequence[SoftMap], own_right: float, votes_right: float
) -> list[SoftMap]:
    """Average own map and votes by the odds that each is right; own maps weigh no less."""
    splats = _odds(votes_right)
    itself = max(_odds(own_right), splats)
    share = np.float32(splats / (itself + splats))
    return [mine + share * (vote - mine) for mine, vote in zip(own, voted, strict=True)]


def _near_outline(mask: NDArray[np.bool_], share: float = COARSE) -> NDArray[np.bool_]:
    """Return the pixels [H, W] closer to a mask's outline than a share of the longest side."""
    reach = max(1, round(share * max(mask.shape)))
    around, binary = disc(reach), mask.astype(np.uint8)
    grown, shrunk = cv2.dilate(binary, around), cv2.erode(binary, around, borderValue=1)
    near: NDArray[np.bool_] = (grown > 0) & (shrunk == 0)
    return near


def _odds(agreement: float) -> float:
    share = min(agreement, BEST)
    return share / (1 - share)


def unless(
    replaced: Sequence[bool], maps: Sequence[SoftMap], others: Sequence[SoftMap]
) -> list[SoftMap]:
    """Return each view's map, or the other one where it is replaced."""
    return [b if other else a for other, a, b in zip(replaced, maps, others, strict=True)]
