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
both edges and silhouettes surely prefer the maps, votes make no masks and correct no outline. In
the end the best votes and the maps are compared by what each set predicts of its own kind: the one
that is surely worth more makes the masks, else the average of both (``vote_checks``).
Elsewhere a view's own map is corrected, not replaced: the average of own map, silhouettes and
votes, weighted by their agreement; of own map and votes along its outline, for which silhouettes
are too coarse, and on plain ground. Own maps stay where that surely leads outlines away from
edges, or makes maps surely worth less by both measures: right maps agree with each other.

Each splat's vote counts from the mean vote on that meets the maps best, but masks are made of a
quarter of the votes: most maps miss more than they invent. Where half of the votes meet maps best,
it is these masks whose agreement counts; but not where ground was cut away, which maps take along.

Parts attached to the object (``attached_parts``) join where they are few and where their outlines
lie on the photos' edges; many join where they have the object's colours, too. Both decisions are
for the capture. A single view keeps the averaged mask if its voted outline lies on edges much less
than its map's and silhouettes agree better with its map. So does a held-out view which the splats,
that have never been fitted to it, surely show worse than those they were fitted to.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mattgs_ops.capture.masks import HALF, SoftMap
from mattgs_ops.object_masks.corrected_maps import (
    averaged,
    corrected,
    corrected_by_all,
    unless,
)
from mattgs_ops.object_masks.map_scores import MapScores, ViewMaps, choose_parts
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.splats.labels import CERTAIN
from mattgs_ops.object_masks.splats.votes import VotedMaps
from mattgs_ops.object_masks.vote_checks import (
    Source,
    choose_masks,
    share_left,
    views_against_votes,
)


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
    is; ``attached`` the area that attached parts add to that of the votes (``clear_alone``: those
    that touch nothing but the object, as not all join), ``alike`` the share of it that has the
    object's colours, where it was measured; ``left`` the share of the maps that
    the masks of the votes leave. ``own_kept``: maps stay as they were, as correcting them makes
    them worse.
    """

    masks: Source
    reason: str
    silhouettes: float
    votes: float | None
    level: float | None
    confirmed: dict[str, float]
    attached: float
    attached_kept: bool
    clear_alone: bool
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


def decide(
    views: ViewMaps, votes: VotedMaps | None, *, final: bool = False
) -> tuple[Decision, list[SoftMap]]:
    """Return the decision, and each view's map [H, W] in [0, 1]: 0.5 is the outline.

    What holds for the capture is decided by the views that are trained on; the others get masks by
    that decision and do not influence it. ``votes`` is None where no view calls a splat object.
    ``final``: these are the best of several votes, and are compared with the maps once more.
    """
    own, others, trained = views.own, views.predicted, views.trained_views
    on_edges = {"maps": own.mean_on_edges(trained)}
    if votes is None:
        found = _without_votes(views, on_edges)
        return found, corrected(own.maps, others, own.maps, views.silhouettes, 0.0, along=own.maps)
    certain, whole = views.score(votes.certain), views.score(votes.with_parts)
    parts, clear_alone = choose_parts(views, certain, votes.with_clear, whole)
    with_parts = parts.scores.mean_on_edges(trained)
    on_edges |= {"votes": certain.mean_on_edges(trained), "attached": with_parts}
    voted = parts.scores if parts.join else certain
    agreements = _votes_agreements(votes, voted, views.with_object)
    left = share_left(views, voted.maps)
    choice = choose_masks(views, votes, voted, agreements, left, final=final)
    against_votes = views_against_votes(views, certain, voted)
    sources: list[Source] = ["maps" if one else choice.masks for one in against_votes]
    mixed, kept = _corrected(views, votes, voted, against_votes if choice.masks == "maps" else None)
    found = Decision(
        masks=choice.masks,
        reason=choice.reason,
        silhouettes=views.silhouettes,
        votes=float(np.mean(agreements)),
        level=votes.level,
        confirmed=on_edges,
        attached=parts.added,
        attached_kept=parts.join,
        clear_alone=clear_alone,
        own_kept=kept,
        alike=parts.alike,
        left=left,
        views=tuple(
            ViewEvidence(*one)
            for one in zip(
                views.names,
                views.by_outline,
                certain.overlap,
                voted.overlap,
                voted.on_edges,
                sources,
                strict=True,
            )
        ),
    )
    chosen = zip(sources, choice.maps, mixed, strict=True)
    return found, [m if source == "maps" else made for source, made, m in chosen]


def _corrected(
    views: ViewMaps, votes: VotedMaps, voted: MapScores, against_votes: Sequence[bool] | None
) -> tuple[list[SoftMap], bool]:
    """Return the own maps as the others and votes correct them, and whether they were kept instead.

    ``against_votes`` is None where votes make the capture's masks, and these maps those of single
    views; else votes count along the outlines of all other views.
    """
    own, along, trained = views.own.maps, views.own.maps, views.trained_views
    if against_votes is not None:
        own_right = views.silhouettes * views.own.mean_on_edges(trained)
        votes_right = voted.mean_overlap(views.with_object) * voted.mean_on_edges(trained)
        along = unless(against_votes, averaged(own, voted.maps, own_right, votes_right), own)
    mixed = corrected_by_all(
        own, views.predicted, votes, views.silhouettes, along, alone=views.plain_ground
    )
    if against_votes is None or not _makes_worse(views, mixed):
        return mixed, False
    return unless([not (one >= HALF).any() for one in own], own, mixed), True


def _without_votes(views: ViewMaps, on_edges: dict[str, float]) -> Decision:
    """Return the decision of a capture whose splats no view calls object."""
    reason = "no splat is salient to the views"
    each = tuple(
        ViewEvidence(name, one, None, None, None, "maps")
        for name, one in zip(views.names, views.by_outline, strict=True)
    )
    return Decision(
        "maps",
        reason,
        views.silhouettes,
        None,
        None,
        on_edges,
        0.0,
        False,
        False,
        False,
        None,
        None,
        each,
    )


def _votes_agreements(
    votes: VotedMaps, voted: MapScores, with_object: Sequence[int]
) -> list[float]:
    """Return the IoU of votes with each view's own map: of others' votes, or of what is delivered.

    The latter counts where half of the votes meet maps best and no ground was cut away.
    """
    if half_meet_best(votes.level) and votes.place.ground is None:
        return [voted.overlap[k] for k in with_object]
    return votes.agreement


def _makes_worse(views: ViewMaps, mixed: Sequence[SoftMap]) -> bool:
    """Whether corrected maps surely lie on photos' edges less than own maps, or are worth less.

    For edges, views without an object in their map are not compared.
    """
    before, after = views.own.on_edges, views.score(mixed).on_edges
    if surely_larger(*([one[k] for k in views.with_object] for one in (before, after))):
        return True
    return surely_larger(views.own_worths, views.worths(mixed))
