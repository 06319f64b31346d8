"""Why votes do not make the masks: of the capture, or of a single view.

``choose_masks`` says it for the capture, in words that go into ``scene.json``: votes surely meet
maps and edges less than silhouettes and maps do, the ground's cut went through the object, edges
and silhouettes surely prefer the maps, or the ground is plain and edges leave nothing to mend. The
best votes are compared with the maps once more, each by what its own kind predicts: votes, maps or,
where neither is surely better by all that counts, the average of both make the masks.
``views_against_votes`` returns which single views keep their own map.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mattgs_ops.capture.masks import HALF, SoftMap
from mattgs_ops.object_masks.corrected_maps import averaged
from mattgs_ops.object_masks.map_scores import MOST_OFF_EDGES, MapScores, ViewMaps
from mattgs_ops.object_masks.photo_evidence.colours import GOOD
from mattgs_ops.object_masks.photo_evidence.significance import lowest_expected, surely_larger
from mattgs_ops.object_masks.silhouettes import CONTRADICT, overlaps
from mattgs_ops.object_masks.splats.votes import VotedMaps

LEAST = 0.01  # agreement below it counts as this much: ratios stay finite
# Of what the maps show: a ground's cut that leaves less went through the object, as through a
# facade on which most points lie. Maps may take along what the object stands on, but hardly three
# times its own size of that.
LEAST_LEFT = 0.25

Source = Literal["votes", "maps", "both"]


@dataclass(frozen=True)
class Choice:
    """Where the capture's masks come from, why, and the maps [H, W] that make them.

    Of ``maps`` these are the votes', which make no mask then.
    """

    masks: Source
    reason: str
    maps: Sequence[SoftMap]


def choose_masks(
    views: ViewMaps,
    votes: VotedMaps,
    voted: MapScores,
    agreements: Sequence[float],
    left: float,
    *,
    final: bool,
) -> Choice:
    """Choose where the capture's masks come from.

    ``voted`` are the masks that the votes would make, ``agreements`` the IoU of votes with the own
    map of each view that has an object, ``left`` see ``share_left``. ``final``: these are the best
    of several votes, and are compared with the maps once more.
    """
    why_not = _why_not_votes(views, votes, voted, agreements, left)
    if why_not:
        return Choice("maps", why_not, voted.maps)
    if final:
        return _choose_by_worths(views, voted)
    reason = "votes do not surely meet maps and edges less than silhouettes do"
    return Choice("votes", reason, voted.maps)


def _why_not_votes(
    views: ViewMaps, votes: VotedMaps, voted: MapScores, agreements: Sequence[float], left: float
) -> str:
    """Say why votes do not make the capture's masks; empty where they do."""
    by_agreement = _why_not_by_agreement(views, voted, agreements)
    if by_agreement:
        return by_agreement
    if votes.place.ground is not None and left < LEAST_LEFT:
        return f"the ground's cut leaves {left:.2f} of what the photos' maps show"
    if maps_surely_better(views, voted):
        return "the photos' edges and the other views' silhouettes surely prefer the maps"
    if views.plain_ground:
        trained = views.trained_views
        by_edges = _why_not_by_edges(voted.mean_on_edges(trained), views.own.mean_on_edges(trained))
        if by_edges:
            return by_edges
    return ""


def maps_surely_better(views: ViewMaps, voted: MapScores) -> bool:
    """Whether own maps surely lie on photos' edges more, and meet silhouettes better, than votes.

    Both count at once: on textured ground a leak's outline lies on edges, too, and silhouettes fill
    the gaps that maps fill.
    """
    compared = views.with_object
    by_votes = overlaps(voted.maps, views.predicted)
    pairs = ((views.own.on_edges, voted.on_edges), (views.by_outline, by_votes))
    return all(surely_larger(*([one[k] for k in compared] for one in pair)) for pair in pairs)


def views_against_votes(views: ViewMaps, certain: MapScores, voted: MapScores) -> list[bool]:
    """Return which views keep their own map: all, where maps are surely better for the capture.

    Else those whose voted outline lies on edges much less than the map's, and whose map silhouettes
    meet better than votes do; and held-out ones that splats surely show worse than trained ones.
    """
    all_views = maps_surely_better(views, voted)
    by_both = overlaps(voted.maps, views.predicted)
    strange = _unlike_trained(voted.overlap, views.by_outline, by_both, views.trained_views)
    seen = views.own.on_edges, voted.on_edges, certain.overlap, views.by_outline, strange
    return [
        all_views or alien or (by_edges < own_edges - MOST_OFF_EDGES and by_votes < by_outline)
        for own_edges, by_edges, by_votes, by_outline, alien in zip(*seen, strict=True)
    ]


def share_left(views: ViewMaps, masks: Sequence[SoftMap]) -> float:
    """Return the share of the photos' own maps that masks [H, W] of all views leave; 1 of none.

    The agreement of others' votes does not see what the ground's cut takes away.
    """
    maps = views.own.maps
    shares = [float((masks[k][maps[k] >= HALF] >= HALF).mean()) for k in views.with_object]
    return float(np.mean(shares)) if shares else 1.0


def _why_not_by_agreement(views: ViewMaps, voted: MapScores, agreements: Sequence[float]) -> str:
    """Say why votes are surely worth less than silhouettes; empty where they are not.

    Each is worth its IoU with the own map times the share of outlines on edges: the votes' own, and
    the maps' for silhouettes. It must be less on average, where silhouettes are compared, and
    surely less view by view: near a tie, bits would decide. Where silhouettes meet the maps less
    than :data:`CONTRADICT`, maps show different things, and to meet them is no merit: votes that
    predict each other surely better are then not held against them.
    """
    trained, compared = views.trained_views, views.with_object
    met, edges = float(np.mean(agreements)), voted.mean_on_edges(trained)
    own_edges = views.own.mean_on_edges(trained)
    if met * edges >= views.silhouettes * own_edges:
        return ""
    by_outline = [views.by_outline[k] * views.own.on_edges[k] for k in compared]
    by_votes = [one * voted.on_edges[k] for k, one in zip(compared, agreements, strict=True)]
    if not surely_larger(by_outline, by_votes):
        return ""
    astray = views.silhouettes < CONTRADICT
    if astray and surely_larger(views.worths(voted.maps), views.own_worths):
        return ""
    return (
        f"votes meet the photos' maps to {met:.2f} and the photos' edges to {edges:.2f}, surely "
        f"less than silhouettes, {views.silhouettes:.2f}, and maps, {own_edges:.2f}, do"
    )


def _choose_by_worths(views: ViewMaps, voted: MapScores) -> Choice:
    """Choose votes, maps, or the average of both, by what each predicts of its own kind.

    What each map misses lowers maps, and is what votes mend; what splats lack, such as a white roof
    on a white sweep, lowers votes. Thin, open things predict each other less, too: votes that are
    worth less, but whose outlines surely lie on edges more, are averaged with the maps. So are
    those that are as good: two guesses of one outline err in different places.
    """
    by_maps, by_votes = views.own_worths, views.worths(voted.maps)
    maps, votes = (float(np.mean(one)) for one in (by_maps, by_votes))
    worth = f"by each other and the photos' edges the maps are worth {maps:.3f}, votes {votes:.3f}"
    if surely_larger(by_votes, by_maps):
        return Choice("votes", f"{worth}, surely more", voted.maps)
    why = "neither is surely better"
    if surely_larger(by_maps, by_votes):
        on_edges = ([one.on_edges[k] for k in views.trained_views] for one in (voted, views.own))
        if not surely_larger(*on_edges):
            return Choice("maps", f"{worth}, surely less", voted.maps)
        why = "surely less, but their outlines surely lie on edges more"
    return Choice("both", f"{worth}: {why}", averaged(views.own.maps, voted.maps, maps, votes))


def _why_not_by_edges(votes: float, maps: float) -> str:
    """Say why votes are not used on plain ground; empty where they are.

    What is an edge there is the object's, and splats hang in front of the ground as they please:
    maps whose outlines lie on edges need no votes.
    """
    if maps < GOOD and votes >= maps:
        return ""
    return f"on plain ground the photos' edges confirm the outlines of the maps to {maps:.3f}, " + (
        f"those of the votes to {votes:.3f}" if maps < GOOD else "which leaves nothing to mend"
    )


def _unlike_trained(
    by_votes: Sequence[float],
    by_outline: Sequence[float],
    by_both: Sequence[float],
    trained_views: Sequence[int],
) -> list[bool]:
    """Return which held-out views the splats surely show worse than those they were trained on.

    There votes meet the own map less than silhouettes do, by a factor below the range in which
    one more view like the training views lies (``lowest_expected``). Of map, silhouettes and votes
    one is wrong there. It is the map, which then is not kept, where silhouettes meet the votes
    better (``by_both``), or share less with the map than they differ.
    """
    ratios = np.log(np.maximum(by_votes, LEAST) / np.maximum(by_outline, LEAST))
    trained = set(trained_views)
    held_out = [index for index in range(len(ratios)) if index not in trained]
    lowest = min(0.0, lowest_expected([ratios[index] for index in trained_views], len(held_out)))
    return [
        index not in trained and outline >= max(CONTRADICT, both) and bool(ratio < lowest)
        for index, (ratio, outline, both) in enumerate(
            zip(ratios, by_outline, by_both, strict=True)
        )
    ]
