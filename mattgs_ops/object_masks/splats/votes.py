"""Votes of all views on each splat, and the masks that follow from them.

The splats of a short training are surfaces that all photos share, and views vote on each
(``labels``). The mean votes, rendered from each camera, are maps on which the views agree. A
second round votes with these maps, stretched between two bounds: it carries the opinion of most
views to parts where few maps are certain. Splats on or under the plane that the object stands on
(``ground_plane``) are not object; splats attached to certain object splats may be
(``attached_parts``), whatever the maps say.

On textureless ground splats fill empty space, and their votes mean nothing: ``decision`` chooses
where votes are used.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.silhouettes import around_half, iou
from mattgs_ops.object_masks.splats import ground_plane
from mattgs_ops.object_masks.splats.attached_parts import Attached, attached, without_stranded
from mattgs_ops.object_masks.splats.labels import (
    CERTAIN,
    Floats,
    Place,
    Tally,
    render_labels,
    shrunk,
    tally,
)
from mattgs_ops.object_masks.splats.location import distances_from, locate, solid, within_reach
from mattgs_ops.splat.gaussians import Splats

LEVELS = (0.125, 0.25, 0.375, 0.5)  # mean votes from which on a splat may be object
# Mean votes of the first round are stretched for the second: to 0 at UNSURE below a middle, to 1 at
# UNSURE above. Single maps miss more of an object than they invent, so a quarter is enough.
QUARTER, UNSURE = 0.25, 0.125
SHARE = 0.5  # of a pixel's colour that must come from the object's splats
CONTACT = 0.04  # of the radius: height above the plane below which a splat is ground, or a foot


@dataclass(frozen=True)
class VotedMaps:
    """The maps that follow from the votes, V views, each map [H, W] in [0, 1].

    ``predicted`` are the maps from the votes of the other views, at least 0.5 on the object;
    ``soft_agreement`` is their IoU with the own map of each view that voted, ``agreement`` the same
    with splats that are either object or not, from the mean vote ``level`` on. ``certain``,
    ``with_clear`` and ``with_parts`` are the maps by all votes: without attached parts, with those
    that touch nothing but the object, and with all; ``place`` is where the object is.
    """

    predicted: list[SoftMap]
    agreement: list[float]
    soft_agreement: list[float]
    level: float
    certain: list[SoftMap]
    with_clear: list[SoftMap]
    with_parts: list[SoftMap]
    place: Place


@dataclass(frozen=True)
class SplatVotes:
    """The views' votes on the splats, and what others' votes predict; masks follow in several ways.

    ``voters`` are the cameras of the views that are trained on, at the size for voting, ``direct``
    [N] the mean votes of the photos' own maps, ``weights`` [N] how much views see of each splat.
    The rest is as in :class:`VotedMaps`.
    """

    splats: Splats
    voters: list[Camera]
    direct: Floats
    weights: Floats
    place: Place
    predicted: list[SoftMap]
    agreement: list[float]
    soft_agreement: list[float]
    level: float


def collect(
    splats: Splats,
    voting: Sequence[Camera],
    maps: Sequence[SoftMap],
    points: NDArray[np.float64] | None = None,
    *,
    trained: Sequence[bool] | None = None,
    threads: int = 1,
) -> SplatVotes | None:
    """Let the views vote; None where no splat is salient to them.

    ``voting`` are the views' cameras at the size for voting. ``maps`` [H, W] in [0, 1], of any
    size; views whose map shows nothing, and those that are not ``trained`` on (None: all are), do
    not vote. ``points`` [P, 3] are triangulated ones: the ground is sought among them first.
    """
    trained = trained or [True] * len(maps)
    can_vote = [bool((m >= CERTAIN).any()) and use for m, use in zip(maps, trained, strict=True)]
    voters = [camera for camera, votes in zip(voting, can_vote, strict=True) if votes]
    voting_maps = [soft for soft, votes in zip(maps, can_vote, strict=True) if votes]
    if not voting_maps:
        return None
    tallied = tally(splats, voters, voting_maps, threads=threads)
    weights = tallied.weight.sum(axis=0)
    around = [camera for camera, use in zip(voting, trained, strict=True) if use]
    place = locate(splats, tallied.labels(), weights, around, points)
    if place is None:
        return None
    tallied = tallied.among(within_reach(splats, place))
    by_others = _by_others(splats, voting, maps, can_vote, tallied, place, threads)
    return SplatVotes(splats, around, tallied.labels(), weights, place, *by_others)


def masks_of(
    splat_votes: SplatVotes,
    shown: Sequence[Camera],
    *,
    cut_ground: bool = True,
    half_needed: bool = False,
    threads: int = 1,
) -> VotedMaps:
    """Return the maps that follow from the votes, for the cameras ``shown``, of the masks' size.

    Without ``cut_ground`` what lies on the ground is object where the votes say so. With
    ``half_needed`` the second round needs half of the first one's votes instead of a quarter.
    """
    splats, place, weights = splat_votes.splats, splat_votes.place, splat_votes.weights
    labels = without_ground(splats, splat_votes.direct, place) if cut_ground else splat_votes.direct
    middle = CERTAIN if half_needed else QUARTER
    first = [
        stretched(render_labels(splats, [labels], camera, place, threads=threads)[0], middle)
        for camera in splat_votes.voters
    ]
    second = tally(splats, splat_votes.voters, first, threads=threads)
    again = second.among(within_reach(splats, place)).labels()
    voted = without_ground(splats, again, place) if cut_ground else again
    certain = (voted >= CERTAIN).astype(np.float32)
    joined = with_attached_parts(splats, again, weights, place, splat_votes.direct)
    answers = [certain, *(one.astype(np.float32) for one in (joined.clear, joined.whole))]
    if not cut_ground:
        seen, far = solid(splats, weights), distances_from(splats, place)
        uncut = without_stranded(splats, certain > 0, seen, far)
        answers[1:] = [np.maximum(one, uncut) for one in answers[1:]]
    by_all = [render_labels(splats, answers, camera, place, threads=threads) for camera in shown]
    of_certain, of_clear, of_whole = ([maps[k] for maps in by_all] for k in range(3))
    return VotedMaps(
        splat_votes.predicted,
        splat_votes.agreement,
        splat_votes.soft_agreement,
        splat_votes.level,
        of_certain,
        of_clear,
        of_whole,
        place,
    )


def _by_others(
    splats: Splats,
    cameras: Sequence[Camera],
    maps: Sequence[SoftMap],
    can_vote: Sequence[bool],
    tallied: Tally,
    place: Place,
    threads: int,
) -> tuple[list[SoftMap], list[float], list[float], float]:
    """Predict every view from the other views' votes; see :class:`VotedMaps` for what is returned.

    The bound from which on a splat is object is the one of :data:`LEVELS` that agrees best with the
    views' own maps.
    """
    own, labels, soft, voter = [], [], [], 0
    for camera, mine, votes in zip(cameras, maps, can_vote, strict=True):
        own.append(shrunk(mine, camera) >= CERTAIN)
        labels.append(tallied.labels(voter if votes else None))
        soft += render_labels(splats, labels[-1:], camera, place, threads=threads)
        voter += votes
    compared = [index for index, votes in enumerate(can_vote) if votes]
    agreement = {level: [iou(soft[k] >= level, own[k]) for k in compared] for level in LEVELS}
    best = float(LEVELS[int(np.argmax([np.mean(agreement[level]) for level in LEVELS]))])
    firm = []
    for k in compared:
        either = (labels[k] >= best).astype(np.float32)
        shown = render_labels(splats, [either], cameras[k], place, threads=threads)[0]
        firm.append(iou(shown >= SHARE, own[k]))
    return [around_half(one, best) for one in soft], firm, agreement[best], best


def without_ground(splats: Splats, labels: Floats, place: Place) -> Floats:
    """Return the labels [N], 0 for what lies on the ground or under it, if there is ground."""
    if place.ground is None:
        return labels
    heights = place.ground.heights(splats.means.numpy().astype(np.float64))
    return np.where(heights < CONTACT * place.radius, 0, labels).astype(np.float32)


def with_attached_parts(
    splats: Splats, labels: Floats, weights: Floats, place: Place, direct: Floats | None = None
) -> Attached:
    """Return which splats [N] are certain object or attached to it.

    ``direct`` are the labels of the photos' own maps: what they call object where the ground begins
    may be the object's feet. The second round's maps know nothing of it, as the ground was cut.
    """
    raised = without_ground(splats, np.ones_like(labels), place) > 0
    seen, distances = solid(splats, weights), distances_from(splats, place)
    found = attached(splats, labels >= CERTAIN, seen, raised, distances)
    if direct is None or place.ground is None:
        return found
    means, salient = splats.means.numpy().astype(np.float64), direct >= CERTAIN
    ground, reach = place.ground, CONTACT * place.radius
    both = (found.whole, found.clear)
    return Attached(*(one | _feet(means, one, salient, ground, reach) for one in both))


def _feet(
    means: NDArray[np.float64],
    belongs: NDArray[np.bool_],
    salient: NDArray[np.bool_],
    ground: ground_plane.Plane,
    reach: float,
) -> NDArray[np.bool_]:
    """Return which splats [N] where the ground begins are what the object stands on it with.

    They are ``salient`` in the photos' maps and lie within ``reach`` of the plane, under what
    ``belongs`` to the object up to twice as high, or at most as far beside it. A shadow on the
    ground may be salient, too, but has air above.
    """
    heights = ground.heights(means)
    along = means - heights[:, None] * ground.normal
    above = belongs & (heights < 2 * reach)
    feet = salient & (np.abs(heights) < reach)
    if not above.any() or not feet.any():
        return np.zeros_like(belongs)
    feet[feet] = cKDTree(along[above]).query(along[feet])[0] <= reach
    return feet


def stretched(soft: SoftMap, middle: float) -> SoftMap:
    """Stretch a map of mean votes [H, W] to 0 and 1 around the mean vote that becomes a half."""
    wide: SoftMap = (soft - np.float32(middle - UNSURE)) / np.float32(2 * UNSURE)
    return wide.clip(0, 1)
