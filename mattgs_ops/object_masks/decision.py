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
ground only where outlines of the maps miss edges, and theirs lie on them at least as much. Where
both edges and silhouettes surely prefer the maps, votes change nothing (``objections``).
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
been fitted to it, surely show worse than those they were fitted to.
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
from mattgs_ops.object_masks.objections import denied_views, objection, share_left
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.splats.votes import CERTAIN, Votes
from mattgs_ops.object_masks.witnesses import Known, Witnessed, judge_parts

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
    left = share_left(known, voted.maps)
    against = objection(known, votes, voted, agreement, confirmed, left)
    denied = denied_views(known, certain, voted)
    sources: list[Source] = ["maps" if against or one else "votes" for one in denied]
    mixed, kept = _corrected(known, votes, voted, denied if against else None)
    found = Decision(
        masks="maps" if against else "votes",
        reason=against or "votes meet maps and edges at least as well as silhouettes and maps do",
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
