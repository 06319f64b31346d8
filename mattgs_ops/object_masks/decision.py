"""Whether masks come from the splats' votes, or from the photos' own maps and shared silhouettes.

The true masks are unknown, but both can be compared with each view's own map:

- ``silhouettes`` is the mean IoU of a view's map with the outline that the *other* maps predict for
  it (``silhouettes``). Correct maps agree with each other, on black cloth as on a desk.
- ``votes`` is its mean IoU with splats on which the *other* maps voted, each splat either object or
  not. Splats on the true surfaces agree with maps better than outlines do, because they occlude
  each other. Haze in textureless space agrees worse.

The photos are the second test: no object ends in the middle of even black cloth. Each agreement is
therefore multiplied by the share of the outlines, of votes and of maps, that lies on photos' edges.
Where votes score at least as well, they are the masks, even against a view's own map. Elsewhere a
view's own map is corrected, not replaced: the average of own map, silhouettes and votes, weighted
by their agreement; and not even that where the photos' edges are against it.

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

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.photo_colours import share_alike
from mattgs_ops.object_masks.photo_edges import edges_near, share_on_edges, surely_larger
from mattgs_ops.object_masks.silhouettes import (
    CONTRADICT,
    HALF,
    Silhouettes,
    corrected,
    overlaps,
)
from mattgs_ops.object_masks.splat_votes import Votes

# Outlines are coarse, and fur has no edge: some of each runs beside the photo's edges. A quarter
# more of it than of the outline that it would replace is not that.
UNCONFIRMED = 0.25
MOST_ATTACHED = 0.5  # of the certain area: what adds more is no correction unless colours say so
LEAST = 0.01  # agreement below it counts as this much: ratios stay finite

Source = Literal["votes", "maps"]
Bits = NDArray[np.bool_]


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
    it that has the object's colours, where it was asked for. ``own_kept``: maps stay as they were,
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
    views: tuple[ViewEvidence, ...]


def decide(
    names: Sequence[str],
    photos: Sequence[NDArray[np.uint8]],
    own: Sequence[SoftMap],
    silhouettes: Silhouettes,
    votes: Votes | None,
    trained: Sequence[bool] | None = None,
) -> tuple[Decision, list[SoftMap]]:
    """Return the decision, and each view's map [H, W] in [0, 1]: 0.5 is the outline.

    ``photos`` [H, W, 3] and ``own`` [H, W] have the size of the votes. What holds for the capture
    is decided by the views that are ``trained`` on (None: all are); the others get masks by that
    decision and do not influence it.
    """
    deciding = [index for index in range(len(names)) if trained is None or trained[index]]
    edges = [edges_near(photo) for photo in photos]
    others = [
        _resized(soft, mine.shape) for soft, mine in zip(silhouettes.predicted, own, strict=True)
    ]
    by_outline = overlaps(own, others)
    outline_agreement = silhouettes.mean
    confirmed = {"maps": _confirmed(own, edges, deciding)}
    if votes is None:
        reason = "no splat is salient to the views"
        views = tuple(
            ViewEvidence(name, one, None, None, None, "maps")
            for name, one in zip(names, by_outline, strict=True)
        )
        maps = corrected(own, others, own, outline_agreement, 0.0)
        decision = Decision(
            "maps", reason, outline_agreement, None, None, confirmed, 0.0, False, False, None, views
        )
        return decision, maps
    by_votes = overlaps(own, votes.certain)
    votes_agreement = float(np.mean(votes.agreement))
    confirmed["votes"] = _confirmed(votes.certain, edges, deciding)
    confirmed["attached"] = _confirmed(votes.with_parts, edges, deciding)
    attached = max(
        0.0, _area(votes.with_parts, deciding) / max(_area(votes.certain, deciding), 1e-9) - 1
    )
    if attached <= MOST_ATTACHED:
        alike = None
        joins = confirmed["attached"] >= confirmed["votes"] - UNCONFIRMED
        joins = joins and not _parts_denied(votes, own, edges, deciding)
    else:
        alike = _alike(photos, votes, deciding)
        joins = confirmed["attached"] >= confirmed["votes"]
        joins = joins and surely_larger(alike, [HALF] * len(alike))
    voted = votes.with_parts if joins else votes.certain
    with_parts = overlaps(own, voted)
    if votes.level >= HALF and votes.place.ground is None:
        votes_agreement = float(
            np.mean([with_parts[k] for k in deciding if (own[k] >= HALF).any()] or [0.0])
        )
    objection = _objection(outline_agreement, votes_agreement, confirmed)
    strange = _unlike_trained(with_parts, by_outline, deciding)
    sources = [
        _source(objection, *view)
        for view in zip(own, voted, edges, by_outline, by_votes, strange, strict=True)
    ]
    on_edges = [share_on_edges(v >= HALF, edge) for v, edge in zip(voted, edges, strict=True)]
    predicted = [
        _resized(soft, mine.shape) for soft, mine in zip(votes.predicted, own, strict=True)
    ]
    kept = False
    fused = corrected(
        own, others, predicted, outline_agreement, float(np.mean(votes.soft_agreement))
    )
    if objection and _denied(own, fused, edges, deciding):
        kept = True
        fused = [mine if (mine >= HALF).any() else f for mine, f in zip(own, fused, strict=True)]
    maps = [
        v if source == "votes" else f for source, v, f in zip(sources, voted, fused, strict=True)
    ]
    found = Decision(
        masks="maps" if objection else "votes",
        reason=objection or "votes meet maps and edges at least as well as silhouettes and maps do",
        silhouettes=outline_agreement,
        votes=votes_agreement,
        level=votes.level,
        confirmed=confirmed,
        attached=attached,
        attached_kept=joins,
        own_kept=kept,
        alike=None if alike is None else float(np.mean(alike)),
        views=tuple(
            ViewEvidence(*one)
            for one in zip(names, by_outline, by_votes, with_parts, on_edges, sources, strict=True)
        ),
    )
    return found, maps


def _parts_denied(
    votes: Votes, own: Sequence[SoftMap], edges: Sequence[Bits], deciding: Sequence[int]
) -> bool:
    """Whether attached parts lead outlines away from photos' edges and masks from photos' maps.

    Maps alone must not deny them: they miss the very parts that join.
    """
    mine, near = [own[index] for index in deciding], [edges[index] for index in deciding]

    def witnesses(maps: Sequence[SoftMap]) -> tuple[list[float], list[float]]:
        asked = [maps[index] for index in deciding]
        on_edges = [
            share_on_edges(one >= HALF, edge) for one, edge in zip(asked, near, strict=True)
        ]
        return on_edges, overlaps(asked, mine)

    without, joined = witnesses(votes.certain), witnesses(votes.with_parts)
    return all(surely_larger(*pair) for pair in zip(without, joined, strict=True))


def _denied(
    own: Sequence[SoftMap],
    fused: Sequence[SoftMap],
    edges: Sequence[Bits],
    deciding: Sequence[int],
) -> bool:
    """Whether outlines of corrected maps surely lie on photos' edges less than those of the maps.

    Views without an object in their own map are not asked.
    """
    asked = [k for k in deciding if (own[k] >= HALF).any()]
    shares = [[share_on_edges(maps[k] >= HALF, edges[k]) for k in asked] for maps in (own, fused)]
    return surely_larger(*shares)


def _alike(
    photos: Sequence[NDArray[np.uint8]], votes: Votes, deciding: Sequence[int]
) -> list[float]:
    """Return which share of the attached parts has the colours of the votes' object, by view."""
    pairs = [(photos[k], votes.certain[k] >= HALF, votes.with_parts[k] >= HALF) for k in deciding]
    return [share_alike(photo, thing, whole & ~thing, ~whole) for photo, thing, whole in pairs]


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


def _source(
    objection: str,
    own: SoftMap,
    voted: SoftMap,
    edges: Bits,
    by_outline: float,
    by_votes: float,
    strange: bool,
) -> Source:
    """Return one view's source: votes, unless the capture's or the view's evidence is against."""
    unconfirmed = (
        share_on_edges(voted >= HALF, edges) < share_on_edges(own >= HALF, edges) - UNCONFIRMED
    )
    denied = strange or (unconfirmed and by_votes < by_outline)
    return "maps" if objection or denied else "votes"


def _area(maps: Sequence[SoftMap], deciding: Sequence[int]) -> float:
    return sum(float((maps[index] >= HALF).mean()) for index in deciding)


def _objection(silhouettes: float, votes: float, confirmed: dict[str, float]) -> str:
    """Say why votes are not used; empty where they are."""
    if votes * confirmed["votes"] >= silhouettes * confirmed["maps"]:
        return ""
    return (
        f"votes meet the photos' maps to {votes:.2f} and the photos' edges to "
        f"{confirmed['votes']:.2f}, less than silhouettes, {silhouettes:.2f}, and maps, "
        f"{confirmed['maps']:.2f}, do"
    )


def _confirmed(maps: Sequence[SoftMap], edges: Sequence[Bits], deciding: Sequence[int]) -> float:
    return float(np.mean([share_on_edges(maps[index] >= HALF, edges[index]) for index in deciding]))


def _resized(soft: SoftMap, shape: tuple[int, ...]) -> SoftMap:
    resized: SoftMap = cv2.resize(soft, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    return resized
