"""How good maps are, by two measures: overlap with each photo's own map, and the photo's edges.

``MapScores`` holds a set of maps, one a view, with both numbers of each; ``ViewMaps`` what views
have before they vote. ``choose_parts`` decides by the two measures, and by the object's colours,
whether the parts that are attached to the votes' object join it. ``worths`` compares whole sets of
maps, each by what its maps predict of each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import HALF, SoftMap
from mattgs_ops.object_masks import silhouettes
from mattgs_ops.object_masks.photo_evidence.colours import share_alike
from mattgs_ops.object_masks.photo_evidence.edges import edges_near, share_on_edges
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.silhouettes import Silhouettes, overlaps, resized
from mattgs_ops.object_masks.splats.labels import shrunk

# Outlines are coarse, and fur has no edge: some of each runs beside the photo's edges. A quarter
# more of it than of the outline that it would replace is not that.
MOST_OFF_EDGES = 0.25
MOST_ATTACHED = 0.5  # of the certain area: what adds more is no correction unless colours are alike

Bits = NDArray[np.bool_]


def worths(
    maps: Sequence[SoftMap],
    cameras: Sequence[Camera],
    edges: Sequence[Bits],
    trained: Sequence[bool],
) -> tuple[list[float], Silhouettes | None]:
    """Return what the map of each view that is trained on is worth, 0 to 1, and the silhouettes.

    It is the IoU of map and silhouette, what the other views' maps predict of it, times the share
    of its outline that lies on edges. ``maps`` [H, W] in [0, 1] have the size of ``edges``,
    ``cameras`` that at which silhouettes are compared. A map without an object is worth nothing;
    so are all, and silhouettes are None, where the maps share no object.
    """
    small = list(map(shrunk, maps, cameras))
    outlines = silhouettes.predict(cameras, small, trained)
    used = [k for k, use in enumerate(trained) if use]
    if outlines is None:
        return [0.0] * len(used), None
    with_object = [k for k in used if (small[k] >= HALF).any()]
    overlap = dict(zip(with_object, outlines.agreement, strict=True))
    return [
        overlap[k] * share_on_edges(maps[k] >= HALF, edges[k]) if k in overlap else 0.0
        for k in used
    ], outlines


@dataclass(frozen=True)
class MapScores:
    """Maps [H, W] of V views, and the two measures of each.

    ``on_edges`` is the share of its outline on edges of the photo, ``overlap`` its IoU with the
    photo's own map.
    """

    maps: Sequence[SoftMap]
    on_edges: list[float]
    overlap: list[float]

    @classmethod
    def of(
        cls, maps: Sequence[SoftMap], own: Sequence[SoftMap], edges: Sequence[Bits]
    ) -> "MapScores":
        """Compare ``maps`` with the photos' edges and own maps."""
        shares = [share_on_edges(one >= HALF, edge) for one, edge in zip(maps, edges, strict=True)]
        return cls(maps, shares, overlaps(own, maps))

    def mean_on_edges(self, views: Sequence[int]) -> float:
        """Return the mean share of these views' outlines that lies on edges."""
        return float(np.mean([self.on_edges[k] for k in views]))

    def mean_overlap(self, views: Sequence[int]) -> float:
        """Return the mean IoU of these views' maps with their own; 0 of no views."""
        return float(np.mean([self.overlap[k] for k in views])) if views else 0.0

    def area(self, views: Sequence[int]) -> float:
        """Return the sum of these views' shares of object."""
        return sum(float((self.maps[k] >= HALF).mean()) for k in views)


@dataclass(frozen=True)
class ViewMaps:
    """What V views have before any vote, the same for every variant of the vote.

    ``photos`` [H, W, 3] RGB and the ``own`` maps [H, W] in [0, 1] have the size of the votes;
    ``edges`` [H, W] are those of the photos. ``predicted`` [H, W] are the maps by the other views'
    silhouettes, of the same size, ``by_outline`` their IoU with the own maps, ``silhouettes``
    the mean of that; ``cameras`` have the size at which silhouettes are compared. Views that are
    not ``trained`` on get masks and do not influence what is decided for the capture.
    ``plain_ground``: the ground is smooth and has no edges of its own.
    """

    names: Sequence[str]
    photos: Sequence[NDArray[np.uint8]]
    edges: Sequence[Bits]
    own: MapScores
    predicted: Sequence[SoftMap]
    by_outline: list[float]
    silhouettes: float
    cameras: Sequence[Camera]
    trained: Sequence[bool]
    plain_ground: bool

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        photos: Sequence[NDArray[np.uint8]],
        own: Sequence[SoftMap],
        outlines: Silhouettes,
        cameras: Sequence[Camera],
        trained: Sequence[bool] | None = None,
        *,
        plain_ground: bool = False,
    ) -> "ViewMaps":
        """Compare own maps with the photos' edges and the silhouettes; None: all are trained on."""
        edges = [edges_near(photo) for photo in photos]
        predicted = resized(outlines.predicted, own)
        return cls(
            names,
            photos,
            edges,
            MapScores.of(own, own, edges),
            predicted,
            overlaps(own, predicted),
            outlines.mean,
            cameras,
            [True] * len(names) if trained is None else trained,
            plain_ground,
        )

    @cached_property
    def trained_views(self) -> list[int]:
        """The views that are trained on."""
        return [index for index, use in enumerate(self.trained) if use]

    @cached_property
    def with_object(self) -> list[int]:
        """Those of them whose map shows an object."""
        return [index for index in self.trained_views if (self.own.maps[index] >= HALF).any()]

    def score(self, maps: Sequence[SoftMap]) -> MapScores:
        """Measure other maps [H, W] of these views."""
        return MapScores.of(maps, self.own.maps, self.edges)

    def worths(self, maps: Sequence[SoftMap]) -> list[float]:
        """Return what maps [H, W] of these views are worth, of each that is trained on."""
        return worths(maps, self.cameras, self.edges, self.trained)[0]

    @cached_property
    def own_worths(self) -> list[float]:
        """What the own maps are worth."""
        return self.worths(self.own.maps)


@dataclass(frozen=True)
class Parts:
    """Whether attached parts join; ``added`` is the area they add to that of the votes.

    ``alike`` is the share of it that has the object's colours, where it was measured; ``scores``
    are those of the votes' object with these parts, whether they join or not.
    """

    added: float
    join: bool
    alike: float | None
    scores: MapScores


def choose_parts(
    views: ViewMaps, certain: MapScores, clear: Sequence[SoftMap], whole: MapScores
) -> tuple[Parts, bool]:
    """Decide which parts join the votes' object, ``certain``: all, those that are ``clear``, none.

    Clear parts, which touch nothing but the object, are scored and asked for only where not all
    join. Returns also whether it was they that joined. ``whole`` is the object with all parts.
    """
    parts = parts_that_join(views, certain, whole)
    if parts.join:
        return parts, False
    alone = parts_that_join(views, certain, views.score(clear))
    few = alone.join and alone.added > 0
    return (alone, True) if few else (parts, False)


def parts_that_join(views: ViewMaps, certain: MapScores, whole: MapScores) -> Parts:
    """Decide by the views trained on whether the votes' object, ``certain``, becomes ``whole``.

    Few parts join where outlines with them lie on edges about as much as without, and not both
    measures are surely worse. Many join where outlines with them lie on edges as much and they
    have the object's colours; on plain ground they are the ground, on which splats touch each
    other, and do not.
    """
    trained = views.trained_views
    added = max(0.0, whole.area(trained) / max(certain.area(trained), 1e-9) - 1)
    after, before = whole.mean_on_edges(trained), certain.mean_on_edges(trained)
    if added <= MOST_ATTACHED:
        near = after >= before - MOST_OFF_EDGES
        join = near and not _parts_surely_worse(certain, whole, trained)
        return Parts(added, join, None, whole)
    if views.plain_ground:
        return Parts(added, join=False, alike=None, scores=whole)
    alike = [
        share_alike(views.photos[k], thing := certain.maps[k] >= HALF, both & ~thing, ~both)
        for k in trained
        for both in [whole.maps[k] >= HALF]
    ]
    join = after >= before and surely_larger(alike, [HALF] * len(alike))
    return Parts(added, join, float(np.mean(alike)), whole)


def _parts_surely_worse(certain: MapScores, whole: MapScores, trained: Sequence[int]) -> bool:
    """Whether attached parts lead outlines away from photos' edges and masks from photos' maps.

    Maps alone must not decide: they miss the very parts that join.
    """
    pairs = ((certain.on_edges, whole.on_edges), (certain.overlap, whole.overlap))
    return all(surely_larger(*([one[k] for k in trained] for one in pair)) for pair in pairs)
