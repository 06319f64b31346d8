"""Whether masks come from the splats' votes, or from the photos' own maps and shared silhouettes.

The true masks are unknown, but both can be compared with each view's own map:

- ``silhouettes`` is the mean IoU of a view's map with the outline that the *other* maps predict for
  it (``silhouettes``). Correct maps agree with each other, on black cloth as on a desk.
- ``votes`` is its mean IoU with splats on which the *other* maps voted, each splat either object or
  not. Splats on the true surfaces agree with maps better than outlines do, because they occlude
  each other. Haze in textureless space agrees worse.

The photos are the second test: no object ends in the middle of even black cloth. Each agreement is
therefore multiplied by the share of the outlines, of votes and of maps, that lies on photos' edges.
Where votes score at least as well, they are the masks, even against a view's own map; on plain
ground only where outlines of the maps miss edges, and theirs lie on them at least as much.
Elsewhere a view's own map is corrected, not replaced: the average of own map, silhouettes and
votes, weighted by their agreement; of own map and votes along its outline, for which silhouettes
are too coarse, and on plain ground; and not even that where the photos' edges are against it.

Each splat's vote counts from the mean vote on that meets the maps best, but masks are made of a
quarter of the votes: most maps miss more than they invent. Where half of the votes meet maps best,
it is these masks whose agreement counts; but not where ground was cut away, which maps take along.

Parts attached to the object (``attached_parts``) join where they are few and where the photos
confirm their outlines; many join where they have the object's colours, too. Both decisions are for
the capture. A single view keeps the averaged mask if its photo does not confirm the voted outline
and silhouettes agree better with its map. So does a held-out view which the splats, that have never
been fitted to it, show worse than all others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mattgs_ops.capture.masks import HALF, SoftMap
from mattgs_ops.object_masks.corrected_maps import (
    averaged,
    corrected,
    corrected_by_all,
    unless,
)
from mattgs_ops.object_masks.photo_evidence.colours import GOOD
from mattgs_ops.object_masks.photo_evidence.edges import surely_larger
from mattgs_ops.object_masks.silhouettes import CONTRADICT
from mattgs_ops.object_masks.splats.votes import CERTAIN, Votes
from mattgs_ops.object_masks.witnesses import UNCONFIRMED, Known, Witnessed, judge_parts

LEAST = 0.01  # agreement below it counts as this much: ratios stay finite
# Of what the maps show: a ground's cut that leaves less went through the object, as through a
# facade on which most points lie. Maps may take along what the object stands on, but hardly three
# times its own size of that.
LEAST_LEFT = 0.25

Source = Literal["votes", "maps"]


@dataclass(frozen=True)
class ViewEvidence:
    """One view: IoU of its own map with silhouettes and votes, and the source of its mask.

    ``with_parts`` is the IoU with the votes and the attached parts that were kept, ``confirmed``
    the share of that outline that lies on an edge of the photo.
    """

    name: str
    silhouettes: float
    votes: float | None
    with_parts: float | None
    confirmed: float | None
    masks: Source


@dataclass(frozen=True)
class Decision:
    """Where a capture's masks come from, and the numbers that say why; all shares are 0 to 1.

    ``level`` is the mean vote from which on splats that are object meet the maps best.
    ``confirmed`` is the share of outlines that lies on an edge of the photo, by whose outline it
    is; ``attached`` the area that attached parts add to that of the votes, ``alike`` the share of
    it that has the object's colours, where it was asked for; ``left`` the share of the maps that
    the masks of the votes leave. ``own_kept``: maps stay as they were,
    as correcting them leads their outlines away from edges.
    """

    masks: Source
    reason: str
    silhouettes: float
    votes: float | None
    level: float | None
    confirmed: dict[str, float]
    attached: float
    attached_kept: bool
    own_kept: bool
    alike: float | None
    left: float | None
    views: tuple[ViewEvidence, ...]


def half_meet_best(level: float) -> bool:
    """Whether splats meet the maps best from half of the votes on.

    Then maps may invent as much as they miss, such as the plate of a turntable in some photos; or
    they are right.
    """
    return level >= CERTAIN


def decide(known: Known, votes: Votes | None) -> tuple[Decision, list[SoftMap]]:
    """Return the decision, and each view's map [H, W] in [0, 1]: 0.5 is the outline.

    What holds for the capture is decided by the views that are trained on; the others get masks by
    that decision and do not influence it. ``votes`` is None where no view calls a splat object.
    """
    own, others, deciding = known.own, known.predicted, known.deciding
    confirmed = {"maps": own.confirmed(deciding)}
    if votes is None:
        found = _without_votes(known, confirmed)
        return found, corrected(own.maps, others, own.maps, known.silhouettes, 0.0, along=own.maps)
    certain, whole = known.ask(votes.certain), known.ask(votes.with_parts)
    confirmed |= {"votes": certain.confirmed(deciding), "attached": whole.confirmed(deciding)}
    parts = judge_parts(known, certain, whole)
    voted = whole if parts.join else certain
    agreement = _votes_agreement(votes, voted, known.speaking)
    objection = _objection(known.silhouettes, agreement, confirmed)
    left = _share_left(known, voted.maps)
    if votes.place.ground is not None and left < LEAST_LEFT:
        objection = objection or f"the ground's cut leaves {left:.2f} of what the photos' maps show"
    if known.plain_ground:
        objection = objection or _objection_of_edges(voted.confirmed(deciding), confirmed["maps"])
    denied = _denied(known, certain, voted)
    sources: list[Source] = ["maps" if objection or one else "votes" for one in denied]
    mixed, kept = _corrected(known, votes, voted, denied if objection else None)
    found = Decision(
        masks="maps" if objection else "votes",
        reason=objection or "votes meet maps and edges at least as well as silhouettes and maps do",
        silhouettes=known.silhouettes,
        votes=agreement,
        level=votes.level,
        confirmed=confirmed,
        attached=parts.added,
        attached_kept=parts.join,
        own_kept=kept,
        alike=parts.alike,
        left=left,
        views=tuple(
            ViewEvidence(*one)
            for one in zip(
                known.names,
                known.by_outline,
                certain.met,
                voted.met,
                voted.on_edges,
                sources,
                strict=True,
            )
        ),
    )
    chosen = zip(sources, voted.maps, mixed, strict=True)
    return found, [v if source == "votes" else m for source, v, m in chosen]


def _corrected(
    known: Known, votes: Votes, voted: Witnessed, denied: Sequence[bool] | None
) -> tuple[list[SoftMap], bool]:
    """Return the own maps as the others and votes correct them, and whether they were kept instead.

    ``denied`` is None where votes make the capture's masks, and these maps those of single views;
    else votes count along the outlines of all views but the denied ones.
    """
    own, along = known.own.maps, known.own.maps
    if denied is not None:
        own_right = known.silhouettes * known.own.confirmed(known.deciding)
        votes_right = voted.meets(known.speaking) * voted.confirmed(known.deciding)
        along = unless(denied, averaged(own, voted.maps, own_right, votes_right), own)
    mixed = corrected_by_all(
        own, known.predicted, votes, known.silhouettes, along, alone=known.plain_ground
    )
    if denied is None or not _leads_away(known, mixed):
        return mixed, False
    return unless([not (one >= HALF).any() for one in own], own, mixed), True


def _without_votes(known: Known, confirmed: dict[str, float]) -> Decision:
    """Return the decision of a capture whose splats no view calls object."""
    reason = "no splat is salient to the views"
    views = tuple(
        ViewEvidence(name, one, None, None, None, "maps")
        for name, one in zip(known.names, known.by_outline, strict=True)
    )
    return Decision(
        "maps",
        reason,
        known.silhouettes,
        None,
        None,
        confirmed,
        0.0,
        False,
        False,
        None,
        None,
        views,
    )


def _votes_agreement(votes: Votes, voted: Witnessed, speaking: Sequence[int]) -> float:
    """Return the mean IoU of votes with own maps: of others' votes, or of what is delivered.

    The latter counts where half of the votes meet maps best and no ground was cut away.
    """
    if half_meet_best(votes.level) and votes.place.ground is None:
        return voted.meets(speaking)
    return float(np.mean(votes.agreement))


def _leads_away(known: Known, mixed: Sequence[SoftMap]) -> bool:
    """Whether outlines of corrected maps surely lie on photos' edges less than those of own maps.

    Views without an object in their map are not asked.
    """
    before, after = known.own.on_edges, known.ask(mixed).on_edges
    return surely_larger(*([one[k] for k in known.speaking] for one in (before, after)))


def _denied(known: Known, certain: Witnessed, voted: Witnessed) -> list[bool]:
    """Return which views' evidence is against their votes.

    The photo does not confirm the voted outline and silhouettes meet the map better than votes do;
    or the view was held out and splats show it worse than all others.
    """
    strange = _unlike_trained(voted.met, known.by_outline, known.deciding)
    seen = known.own.on_edges, voted.on_edges, certain.met, known.by_outline, strange
    return [
        alien or (by_edges < own_edges - UNCONFIRMED and by_votes < by_outline)
        for own_edges, by_edges, by_votes, by_outline, alien in zip(*seen, strict=True)
    ]


def _unlike_trained(
    by_votes: Sequence[float], by_outline: Sequence[float], deciding: Sequence[int]
) -> list[bool]:
    """Return which held-out views the splats show worse than any view that they were trained on.

    There votes meet the own map less than silhouettes do, by a factor that no training view has.
    A map that shares less with silhouettes than it differs is no witness.
    """
    ratios = [
        votes / max(outline, LEAST) for votes, outline in zip(by_votes, by_outline, strict=True)
    ]
    lowest = min((ratios[index] for index in deciding), default=0.0)
    trained = set(deciding)
    return [
        index not in trained and outline >= CONTRADICT and ratio < min(lowest, 1.0)
        for index, (ratio, outline) in enumerate(zip(ratios, by_outline, strict=True))
    ]


def _objection(silhouettes: float, votes: float, confirmed: dict[str, float]) -> str:
    """Say why votes are not used; empty where they are."""
    if votes * confirmed["votes"] >= silhouettes * confirmed["maps"]:
        return ""
    return (
        f"votes meet the photos' maps to {votes:.2f} and the photos' edges to "
        f"{confirmed['votes']:.2f}, less than silhouettes, {silhouettes:.2f}, and maps, "
        f"{confirmed['maps']:.2f}, do"
    )


def _share_left(known: Known, masks: Sequence[SoftMap]) -> float:
    """Return the share of the photos' own maps that masks [H, W] of all views leave; 1 of none.

    The agreement of others' votes does not see what the ground's cut takes away.
    """
    shares = [float((masks[k][known.own.maps[k] >= HALF] >= HALF).mean()) for k in known.speaking]
    return float(np.mean(shares)) if shares else 1.0


def _objection_of_edges(votes: float, maps: float) -> str:
    """Say why votes are not used on plain ground; empty where they are.

    What is an edge there is the object's, and splats hang in front of the ground as they please:
    maps whose outlines lie on edges need no votes.
    """
    if maps < GOOD and votes >= maps:
        return ""
    return f"on plain ground the photos' edges confirm the outlines of the maps to {maps:.3f}, " + (
        f"those of the votes to {votes:.3f}" if maps < GOOD else "which leaves nothing to mend"
    )
