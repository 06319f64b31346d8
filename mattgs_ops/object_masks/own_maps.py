"""Which of several networks' maps are the photos' own: their mean, or one that is surely better.

A file of several networks (``segment.network.ensemble``) outputs their mean and each one's own
map. The mean is the best of them on most captures; but one network may take along the plate on
which an object stands, and one may miss pale things on pale ground. Once cameras are known, two
measures tell, view by view: how well a map meets the outline that the others of its network
predict for it (``silhouettes``), and how much of its outline lies on the photo's edges. Both are
multiplied, as in ``decision``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import HALF, SoftMap
from mattgs_ops.object_masks import silhouettes
from mattgs_ops.object_masks.photo_evidence.edges import edges_near, share_on_edges
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.silhouettes import Silhouettes
from mattgs_ops.object_masks.splats.labels import shrunk


@dataclass(frozen=True)
class OwnMaps:
    """The chosen ``maps`` [H, W], one a view, and which of the networks' they are.

    ``chosen`` is 0 for the mean, and k for the kth network of the file; ``worths`` what each is
    worth on average by the two measures, 0 to 1. ``outlines`` is what the chosen maps predict of
    each other, None where they share no object.
    """

    maps: list[SoftMap]
    outlines: Silhouettes | None
    chosen: int
    worths: tuple[float, ...]


def choose(
    offered: Sequence[list[SoftMap]],
    cameras: Sequence[Camera],
    photos: Sequence[NDArray[np.uint8]],
    trained: Sequence[bool],
) -> OwnMaps:
    """Return the mean's maps, or those of the best network where these are surely worth more.

    ``offered`` has the maps [H, W] in [0, 1] of the mean and of each network, one a view, of the
    ``photos``' sizes [H, W, 3]; ``cameras`` have the size at which silhouettes are compared. Only
    views that are ``trained`` on are compared. A map without an object is worth nothing.
    """
    edges = [edges_near(photo) for photo in photos]
    small = [list(map(shrunk, maps, cameras)) for maps in offered]
    outlines = [silhouettes.predict(cameras, maps, trained) for maps in small]
    worths = [_worths(*one, edges, trained) for one in zip(offered, small, outlines, strict=True)]
    means = tuple(float(np.mean(one)) for one in worths)
    best = int(np.argmax(means))
    chosen = best if surely_larger(worths[best], worths[0]) else 0
    return OwnMaps(offered[chosen], outlines[chosen], chosen, means)


def _worths(
    maps: Sequence[SoftMap],
    small: Sequence[SoftMap],
    outlines: Silhouettes | None,
    edges: Sequence[NDArray[np.bool_]],
    trained: Sequence[bool],
) -> list[float]:
    """Return what each training view's map is worth by the two measures, 0 to 1.

    ``small`` are the maps at the size of ``outlines``.
    """
    used = [k for k, use in enumerate(trained) if use]
    if outlines is None:
        return [0.0] * len(used)
    with_object = [k for k in used if (small[k] >= HALF).any()]
    overlap = dict(zip(with_object, outlines.agreement, strict=True))
    return [overlap.get(k, 0.0) * share_on_edges(maps[k] >= HALF, edges[k]) for k in used]
