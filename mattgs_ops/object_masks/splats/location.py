"""Where the object is among splats: its middle, its radius, and the ground that it stands on.

The splats that votes are certain about fall into pieces that touch each other. The piece that views
see most of is the object's; others belong to it where they begin near it, as wheels and aerials do.
What maps of several photos take along from far behind the object, a cushion for instance, is
another thing: counted in, it would make the object as large as the room, and whatever depends on
the radius would be wrong.
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.object_masks.splats import ground_plane
from mattgs_ops.object_masks.splats.attached_parts import FAR, spreads, touching
from mattgs_ops.object_masks.splats.labels import CERTAIN, UNSEEN, Floats, Place
from mattgs_ops.splat.gaussians import Splats

INSIDE = 0.9  # share of the object's certain splats within its radius
BESIDE = 1.2  # radii: ground goes on beyond the object; a base plate, which it stands on, does not
SOLID = 0.3  # opacity from which on a splat is a surface


def locate(
    splats: Splats,
    labels: Floats,
    weights: Floats,
    cameras: Sequence[Camera],
    points: NDArray[np.float64] | None = None,
) -> Place | None:
    """Find the object among the splats; None where no splat is salient to its views.

    Triangulated ``points`` [P, 3] lie on the ground more exactly than splats of a short training,
    which are thick. Where they show no plane, or there are none, the plane is sought among splats.
    """
    xyz = splats.means.numpy().astype(np.float64)
    surface = solid(splats, weights)
    certain = surface & (labels > CERTAIN)
    if int(certain.sum()) < ground_plane.FEWEST_POINTS:
        return None
    near = _of_one_thing(xyz[certain], spreads(splats)[certain], weights[certain])
    middle, radius = _ball(xyz[certain][near])
    centres = np.array([camera.centre for camera in cameras])
    ground = None
    if points is not None:
        ground = ground_plane.find(points[_beside(points, middle, radius)], radius, centres)
    if ground is None:
        around = xyz[surface & (labels <= CERTAIN) & _beside(xyz, middle, radius)]
        ground = ground_plane.find(around, radius, centres)
    return Place(middle, radius, ground, math.inf if near.all() else FAR * radius)


def within_reach(splats: Splats, place: Place) -> NDArray[np.bool_]:
    """Return which splats [N] are near enough to the object to be a part of it."""
    near: NDArray[np.bool_] = distances_from(splats, place) <= place.reach / place.radius
    return near


def distances_from(splats: Splats, place: Place) -> NDArray[np.float64]:
    """Return how far splats [N] are from the object's middle, in its radii."""
    means = splats.means.numpy().astype(np.float64)
    distances: NDArray[np.float64] = np.linalg.norm(means - place.middle, axis=1) / place.radius
    return distances


def solid(splats: Splats, weights: Floats) -> NDArray[np.bool_]:
    """Return which splats [N] are surfaces: opaque, and seen by the views."""
    opaque: NDArray[np.bool_] = torch.sigmoid(splats.opacity_logits).numpy() > SOLID
    return opaque & (weights > UNSEEN)


def _of_one_thing(
    means: NDArray[np.float64], shapes: NDArray[np.float64], weights: Floats
) -> NDArray[np.bool_]:
    """Return which splats [N] are the piece that views see most of, or begin near it.

    Near is ``FAR`` radii from the middle of what belongs so far; it grows with what joins.
    """
    parts = touching(means, shapes).parts(np.ones(len(means), dtype=np.bool_))
    joined = np.bincount(parts, weights=weights).argmax() == np.arange(int(parts.max()) + 1)
    while True:
        middle, radius = _ball(means[joined[parts]])
        begins = np.full(len(joined), np.inf)
        np.minimum.at(begins, parts, np.linalg.norm(means - middle, axis=1))
        grown = joined | (begins <= FAR * radius)
        if (grown == joined).all():
            belonging: NDArray[np.bool_] = joined[parts]
            return belonging
        joined = grown


def _ball(means: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the middle [3] of splats [N, 3], and the radius within which most of them are."""
    middle: NDArray[np.float64] = np.median(means, axis=0)
    return middle, float(np.quantile(np.linalg.norm(means - middle, axis=1), INSIDE))


def _beside(
    xyz: NDArray[np.float64], middle: NDArray[np.float64], radius: float
) -> NDArray[np.bool_]:
    """Return which points [N, 3] lie where the ground is sought: beside the object, not far off."""
    distances = np.linalg.norm(xyz - middle, axis=1) / radius
    beside: NDArray[np.bool_] = (distances > BESIDE) & (distances < ground_plane.REACH)
    return beside
