"""What photos say about outlines, by two witnesses: each photo's own map, and its edges.

``Witnessed`` holds what both say of a set of maps, one a view, ``Known`` all that is known of views
before they vote. ``judge_parts`` asks the witnesses, and the object's colours, whether the parts
that are attached to the votes' object join it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import HALF, SoftMap
from mattgs_ops.object_masks.photo_evidence.colours import share_alike
from mattgs_ops.object_masks.photo_evidence.edges import edges_near, share_on_edges
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.silhouettes import Silhouettes, overlaps, resized

# Outlines are coarse, and fur has no edge: some of each runs beside the photo's edges. A quarter
# more of it than of the outline that it would replace is not that.
UNCONFIRMED = 0.25
MOST_ATTACHED = 0.5  # of the certain area: what adds more is no correction unless colours say so

Bits = NDArray[np.bool_]


@dataclass(frozen=True)
class Witnessed:
    """Maps [H, W] of V views with what the two witnesses say of each.

    ``on_edges`` is the share of its outline on edges of the photo, ``met`` its IoU with the
    photo's own map.
    """

    maps: Sequence[SoftMap]
    on_edges: list[float]
    met: list[float]

    @classmethod
    def of(
        cls, maps: Sequence[SoftMap], own: Sequence[SoftMap], edges: Sequence[Bits]
    ) -> "Witnessed":
        """Ask edges and own maps about ``maps``."""
        shares = [share_on_edges(one >= HALF, edge) for one, edge in zip(maps, edges, strict=True)]
        return cls(maps, shares, overlaps(own, maps))

    def confirmed(self, views: Sequence[int]) -> float:
        """Return the mean share of these views' outlines that lies on edges."""
        return float(np.mean([self.on_edges[k] for k in views]))

    def meets(self, views: Sequence[int]) -> float:
        """Return the mean IoU of these views' maps with their own; 0 of no views."""
        return float(np.mean([self.met[k] for k in views])) if views else 0.0

    def area(self, views: Sequence[int]) -> float:
        """Return the sum of these views' shares of object."""
        return sum(float((self.maps[k] >= HALF).mean()) for k in views)


@dataclass(frozen=True)
class Known:
    """What is known of V views before any vote, the same for every way of asking for votes.

    ``photos`` [H, W, 3] RGB and the ``own`` maps [H, W] in [0, 1] have the size of the votes;
    ``edges`` [H, W] are those of the photos. ``predicted`` [H, W] is what the other views'
    silhouettes say, of the maps' size, ``by_outline`` its IoU with each own map, ``silhouettes``
    the mean of that. Views that are not ``trained`` on get masks and do not influence what is
    decided for the capture. ``plain_ground``: the maps were corrected by a ground that has no
    edges of its own.
    """

    names: Sequence[str]
    photos: Sequence[NDArray[np.uint8]]
    edges: Sequence[Bits]
    own: Witnessed
    predicted: Sequence[SoftMap]
    by_outline: list[float]
    silhouettes: float
    trained: Sequence[bool]
    plain_ground: bool

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        photos: Sequence[NDArray[np.uint8]],
        own: Sequence[SoftMap],
        outlines: Silhouettes,
        trained: Sequence[bool] | None = None,
        *,
        plain_ground: bool = False,
    ) -> "Known":
        """Hold the own maps against the photos' edges and the silhouettes; None: all trained on."""
        edges = [edges_near(photo) for photo in photos]
        predicted = resized(outlines.predicted, own)
        return cls(
            names,
            photos,
            edges,
            Witnessed.of(own, own, edges),
            predicted,
            overlaps(own, predicted),
            outlines.mean,
            [True] * len(names) if trained is None else trained,
            plain_ground,
        )

    @cached_property
    def deciding(self) -> list[int]:
        """The views that are trained on."""
        return [index for index, use in enumerate(self.trained) if use]

    @cached_property
    def speaking(self) -> list[int]:
        """Those of them whose map shows an object."""
        return [index for index in self.deciding if (self.own.maps[index] >= HALF).any()]

    def ask(self, maps: Sequence[SoftMap]) -> Witnessed:
        """Ask both witnesses about other maps [H, W] of these views."""
        return Witnessed.of(maps, self.own.maps, self.edges)


@dataclass(frozen=True)
class Parts:
    """Whether attached parts join; ``added`` is the area they add to that of the votes.

    ``alike`` is the share of it that has the object's colours, where it was asked for.
    """

    added: float
    join: bool
    alike: float | None


def judge_parts(known: Known, certain: Witnessed, whole: Witnessed) -> Parts:
    """Decide by the views trained on whether the votes' object, ``certain``, becomes ``whole``.

    Few parts join where the photos confirm their outlines about as well as those of the votes, and
    not both witnesses are against them. Many join where their outlines are confirmed as well and
    they have the object's colours; on plain ground they are the ground, on which splats touch each
    other, and do not.
    """
    views = known.deciding
    added = max(0.0, whole.area(views) / max(certain.area(views), 1e-9) - 1)
    confirmed, before = whole.confirmed(views), certain.confirmed(views)
    if added <= MOST_ATTACHED:
        near = confirmed >= before - UNCONFIRMED
        return Parts(added, near and not _denied_by_both(certain, whole, views), None)
    if known.plain_ground:
        return Parts(added, join=False, alike=None)
    alike = [
        share_alike(known.photos[k], thing := certain.maps[k] >= HALF, both & ~thing, ~both)
        for k in views
        for both in [whole.maps[k] >= HALF]
    ]
    join = confirmed >= before and surely_larger(alike, [HALF] * len(alike))
    return Parts(added, join, float(np.mean(alike)))


def _denied_by_both(certain: Witnessed, whole: Witnessed, views: Sequence[int]) -> bool:
    """Whether attached parts lead outlines away from photos' edges and masks from photos' maps.

    Maps alone must not deny them: they miss the very parts that join.
    """
    pairs = ((certain.on_edges, whole.on_edges), (certain.met, whole.met))
    return all(surely_larger(*([one[k] for k in views] for one in pair)) for pair in pairs)
