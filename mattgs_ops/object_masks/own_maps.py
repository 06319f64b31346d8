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
from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.map_scores import worths
from mattgs_ops.object_masks.photo_evidence.edges import edges_near
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.silhouettes import Silhouettes


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
    scored = [worths(maps, cameras, edges, trained) for maps in offered]
    means = tuple(float(np.mean(one)) for one, _ in scored)
    best = int(np.argmax(means))
    chosen = best if surely_larger(scored[best][0], scored[0][0]) else 0
    return OwnMaps(offered[chosen], scored[chosen][1], chosen, means)
