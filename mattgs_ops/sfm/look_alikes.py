"""Whether poses were led astray by sides of the object that look alike.

Opposite sides of a carton, or a print that repeats around a bottle, match as if they were one.
Poses that follow such matches place photos of one side before the other, register all views and
have small errors. What stands beside the object does not repeat with it: two photos that share it,
too, show one side. Wallpaper may repeat as well; so only the pairs of each photo with those that
share most with it are *sure*: right poses explain them. Where poses do not, they are estimated
again, without the pairs that match on the object alone. Groups that share nothing beside the object
contradict by how they stand (``rolled_groups``). Worker process only, but for what is told.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import StageError
from mattgs_ops.naming import listed_names
from mattgs_ops.sfm import rolled_groups
from mattgs_ops.sfm.colmap import mapping
from mattgs_ops.sfm.colmap.features import Pair
from mattgs_ops.sfm.colmap.job import Answer
from mattgs_ops.sfm.colmap.matching import LEAST_MATCHES, Verified
from mattgs_ops.sfm.colmap.moving_object import explained
from mattgs_ops.sfm.colmap.steps import Attempt
from mattgs_ops.sfm.given_poses import FEWEST_PAIRS, PARTNERS
from mattgs_ops.sfm.lost_views import MOST_LISTED, MOST_VIEWS

Pairs = dict[Pair, Verified]

ON_THEIR_SIDE = (
    "lie on their side before the others, to which the object alone ties them, as where a print "
    "repeats on another side, turned by a quarter"
)
APART = "they are not placed by that; take photos between those sides"
NOT_APART = "without these ties next to no photo can be placed; take photos between those sides"
LEFT_OUT = "pairs that match on the object alone are left out, as sides that look alike do"


def place(
    state: Attempt,
    pairs: Pairs,
    positions: Sequence[NDArray[np.float64]],
    place_by: Callable[[Attempt, Pairs], Any],
) -> tuple[Any, Pairs]:
    """Find poses that neither sure pairs nor groups on their side contradict, where there are some.

    ``place_by`` finds poses and points from pairs, as a pycolmap model; ``positions`` are each
    view's key points [K, 2] in pixels. Returns the model and the pairs that it comes from;
    ``state`` has its answer, with the seconds of all. Where a group of views lies on its side, it
    is placed apart: its pairs with the others are left out, so that one of both gets no cameras.
    """
    other = replace(state, answer=deepcopy(state.answer))
    model, kept = _by_sure_pairs(state, pairs, positions, place_by)
    groups = rolled_groups.groups_of(pairs)
    if sum(len(group) >= rolled_groups.FEWEST_VIEWS for group in groups) < 2:
        return model, kept
    cameras = mapping.posed(model)
    rolled = rolled_groups.on_their_side(cameras, groups)
    if not rolled:
        return model, kept
    other.answer.seconds, other.answer.cpu_seconds = state.answer.seconds, state.answer.cpu_seconds
    apart = rolled_groups.without_ties(kept, rolled)
    again = _tried(place_by, other, apart)
    aside = sorted(cameras.keys() & set().union(*rolled))
    names = listed_names([state.job.views[view].name for view in aside], MOST_LISTED)
    if again is None or len(again.reg_image_ids()) < MOST_VIEWS * (len(cameras) - len(aside)):
        state.answer.on_side = f"{names} {ON_THEIR_SIDE}; {NOT_APART}"
        state.answer.tell(state.answer.on_side)
        return model, kept
    other.answer.beside_object = count_explained(apart, again, positions)
    other.answer.fallbacks = list(state.answer.fallbacks)
    other.answer.on_side = f"{names} {ON_THEIR_SIDE}; {APART}"
    other.answer.tell(other.answer.on_side)
    state.answer = other.answer
    return again, apart


def _by_sure_pairs(
    state: Attempt,
    pairs: Pairs,
    positions: Sequence[NDArray[np.float64]],
    place_by: Callable[[Attempt, Pairs], Any],
) -> tuple[Any, Pairs]:
    """Find poses; and again, without pairs on the object alone, where sure pairs contradict them.

    Where that mends nothing, each view keeps its pairs with the partners that share most, however
    little: some of these pairs may be false. The other poses are taken where they leave
    at most half as many sure pairs unexplained, and no more than a twentieth of the views out.
    """
    other = replace(state, answer=deepcopy(state.answer))
    model = place_by(state, pairs)
    told = state.answer.beside_object = count_explained(pairs, model, positions)
    if not unexplained(told):
        return model, pairs
    other.answer.seconds, other.answer.cpu_seconds = state.answer.seconds, state.answer.cpu_seconds
    enough = MOST_VIEWS * len(model.reg_image_ids())
    doubtful = unexplained(told) >= FEWEST_PAIRS  # else one more mapping is enough time for it
    for partners_share in (LEAST_MATCHES, 1) if doubtful else (LEAST_MATCHES,):
        kept = without_look_alikes(pairs, partners_share)
        again = _tried(place_by, other, kept)
        if again is None or len(again.reg_image_ids()) < enough:
            continue
        now = count_explained(pairs, again, positions)
        if 2 * unexplained(now) <= unexplained(told):
            other.answer.beside_object = now
            step = f"{unexplained(told)} of {told['pairs']} pairs that share most beside the object"
            other.answer.tell(f"{step} contradicted the poses: {LEFT_OUT}")
            state.answer = other.answer
            return again, kept
    return model, pairs


def _tried(place_by: Callable[[Attempt, Pairs], Any], state: Attempt, pairs: Pairs) -> Any:
    """Find poses from pairs; None where there are none."""
    try:
        return place_by(state, pairs)
    except StageError:
        return None


def sure_pairs(pairs: Mapping[Pair, Verified]) -> set[Pair]:
    """Return each view's pairs with the :data:`PARTNERS` that share most beside the object.

    They share as many matches there as COLMAP keeps a pair for, or more.
    """
    return _with_partners(pairs, LEAST_MATCHES)


def without_look_alikes(pairs: Pairs, partners_share: int) -> Pairs:
    """Return the pairs that match beside the object, too, as much as sure ones.

    And each view's pairs with its best partners, where these share ``partners_share`` matches
    there. A view all of whose matches are on the object, as of a close photo, keeps all its pairs.
    """
    kept = {pair for pair, one in pairs.items() if one.beside >= LEAST_MATCHES}
    kept |= _with_partners(pairs, partners_share)
    tied = {view for pair in kept for view in pair}
    return {pair: one for pair, one in pairs.items() if pair in kept or not set(pair) <= tied}


def _with_partners(pairs: Mapping[Pair, Verified], least: int) -> set[Pair]:
    """Return each view's pairs with its best partners, of ``least`` matches beside the object."""
    partners: dict[int, list[tuple[int, int, Pair]]] = {}
    for pair, one in pairs.items():
        if one.beside >= least:
            for view in pair:
                partners.setdefault(view, []).append((-one.beside, -len(one.matches), pair))
    return {pair for those in partners.values() for _, _, pair in sorted(those)[:PARTNERS]}


def count_explained(
    pairs: Pairs, model: Any, positions: Sequence[NDArray[np.float64]]
) -> dict[str, int]:
    """Count the sure pairs whose views are placed, and those that a model's poses explain.

    And the groups of placed views that matches beside the object tie: how these lie to each other
    rests on the object alone.
    """
    cameras = mapping.posed(model)
    placed = {pair for pair in sure_pairs(pairs) if set(pair) <= set(cameras)}
    rays = mapping.rays_by(model, positions)
    count = sum(explained(pair, pairs[pair].matches, cameras, rays) for pair in placed)
    groups = [cameras.keys() & group for group in rolled_groups.groups_of(pairs)]
    several = sum(len(group) > 1 for group in groups)
    return {"pairs": len(placed), "explained": count, "groups": several}


def unexplained(told: Mapping[str, int]) -> int:
    """Return how many sure pairs the poses do not explain."""
    return told.get("pairs", 0) - told.get("explained", 0)


def confirmed(told: Mapping[str, int]) -> bool:
    """Whether enough sure pairs tell, and the poses explain all but what may match falsely.

    Of several groups that share nothing beside the object each may be right by itself.
    """
    tied = told.get("groups", 1) <= 1
    return tied and told.get("pairs", 0) >= FEWEST_PAIRS > unexplained(told)


def warnings(answer: Answer) -> list[str]:
    """Return what a reader must know of poses that sure pairs contradict, or that lie on a side."""
    on_side = [answer.on_side] if answer.on_side else []
    told = answer.beside_object
    if answer.mode != "shared" or unexplained(told) < FEWEST_PAIRS:
        return on_side
    text = (
        f"of {told['pairs']} pairs of photos that share most beside the object "
        f"{unexplained(told)} contradict their cameras; some photos stand in the wrong place, as "
        "where sides of the object look alike: take more photos between the sides, or put "
        "something beside it"
    )
    return [text, *on_side]


def in_doubt(answer: Answer) -> bool:
    """Whether more sure pairs contradict the poses of whole photos than may match falsely.

    The bound is that of given cameras (:data:`FEWEST_PAIRS`). Poses of an object that moves are its
    own, and say nothing of what stands beside it. Or whether photos that lie on their side stay so.
    """
    stay = answer.on_side.endswith(NOT_APART)
    return stay or (answer.mode == "shared" and unexplained(answer.beside_object) >= FEWEST_PAIRS)
