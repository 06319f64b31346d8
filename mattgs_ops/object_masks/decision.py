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
from mattgs_ops.object_masks.photo_evidence.colours import share_alike
from mattgs_ops.object_masks.photo_evidence.edges import edges_near, share_on_edges, surely_larger
from mattgs_ops.object_masks.silhouettes import CONTRADICT, HALF, Silhouettes, corrected, overlaps
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
    others = _resized(silhouettes.predicted, own)
    by_outline = overlaps(own, others)
    outline_agreement = silhouettes.mean
    own_on_edges = _shares(own, edges)
    confirmed = {"maps": _mean(own_on_edges, deciding)}
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
    certain = _Witnessed.of(votes.certain, own, edges)
    whole = _Witnessed.of(votes.with_parts, own, edges)
    confirmed["votes"] = _mean(certain.on_edges, deciding)
    confirmed["attached"] = _mean(whole.on_edges, deciding)
    attached = max(
        0.0, _area(votes.with_parts, deciding) / max(_area(votes.certain, deciding), 1e-9) - 1
    )
    if attached <= MOST_ATTACHED:
        alike = None
        joins = confirmed["attached"] >= confirmed["votes"] - UNCONFIRMED
        joins = joins and not _parts_denied(certain, whole, deciding)
    else:
        alike = _alike(photos, votes, deciding)
        joins = confirmed["attached"] >= confirmed["votes"]
        joins = joins and surely_larger(alike, [HALF] * len(alike))
    voted = whole if joins else certain
    speaking = [k for k in deciding if (own[k] >= HALF).any()]
    votes_agreement = float(np.mean(votes.agreement))
    if votes.level >= HALF and votes.place.ground is None:
        votes_agreement = _mean(voted.met, speaking) if speaking else 0.0
    objection = _objection(outline_agreement, votes_agreement, confirmed)
    strange = _unlike_trained(voted.met, by_outline, deciding)
    sources = [
        _source(objection, *view)
        for view in zip(own_on_edges, voted.on_edges, by_outline, certain.met, strange, strict=True)
    ]
    splats_agreement = float(np.mean(votes.soft_agreement))
    fused = corrected(
        own, others, _resized(votes.predicted, own), outline_agreement, splats_agreement
    )
    kept = bool(objection) and _denied(own_on_edges, fused, edges, speaking)
    if kept:
        fused = [one if (one >= HALF).any() else f for one, f in zip(own, fused, strict=True)]
    maps = [
        v if source == "votes" else f
        for source, v, f in zip(sources, voted.maps, fused, strict=True)
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
            for one in zip(
                names, by_outline, certain.met, voted.met, voted.on_edges, sources, strict=True
            )
        ),
    )
    return found, maps


@dataclass(frozen=True)
class _Witnessed:
    """Maps with what the two witnesses say of each.

    ``on_edges`` is the share of its outline on edges of the photo, ``met`` its IoU with the
    photo's own map.
    """

    maps: Sequence[SoftMap]
    on_edges: list[float]
    met: list[float]

    @classmethod
    def of(
        cls, maps: Sequence[SoftMap], own: Sequence[SoftMap], edges: Sequence[Bits]
    ) -> "_Witnessed":
        """Ask edges and own maps about ``maps`` [H, W]."""
        return cls(maps, _shares(maps, edges), overlaps(own, maps))


def _shares(maps: Sequence[SoftMap], edges: Sequence[Bits]) -> list[float]:
    """Return the share of each map's outline that lies on edges of its photo."""
    return [share_on_edges(one >= HALF, edge) for one, edge in zip(maps, edges, strict=True)]


def _parts_denied(certain: _Witnessed, whole: _Witnessed, deciding: Sequence[int]) -> bool:
    """Whether attached parts lead outlines away from photos' edges and masks from photos' maps.

    Maps alone must not deny them: they miss the very parts that join.
    """
    pairs = ((certain.on_edges, whole.on_edges), (certain.met, whole.met))
    return all(surely_larger(*([one[k] for k in deciding] for one in pair)) for pair in pairs)


def _denied(
    own_shares: Sequence[float],
    fused: Sequence[SoftMap],
    edges: Sequence[Bits],
    asked: Sequence[int],
) -> bool:
    """Whether outlines of corrected maps surely lie on photos' edges less than those of the maps.

    Views without an object in their own map are not ``asked``.
    """
    shares = _shares([fused[k] for k in asked], [edges[k] for k in asked])
    return surely_larger([own_shares[k] for k in asked], shares)


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
    own_on_edges: float,
    voted_on_edges: float,
    by_outline: float,
    by_votes: float,
    strange: bool,
) -> Source:
    """Return one view's source: votes, unless the capture's or the view's evidence is against."""
    unconfirmed = voted_on_edges < own_on_edges - UNCONFIRMED
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


def _mean(numbers: Sequence[float], views: Sequence[int]) -> float:
    return float(np.mean([numbers[k] for k in views]))


def _resized(maps: Sequence[SoftMap], like: Sequence[SoftMap]) -> list[SoftMap]:
    """Return each map [H, W] at the size of another."""
    return [
        np.asarray(cv2.resize(soft, one.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        for soft, one in zip(maps, like, strict=True)
    ]
