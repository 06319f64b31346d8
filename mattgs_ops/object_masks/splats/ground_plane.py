"""The plane an object stands on, found among the points around it.

Objects are photographed on desks and floors. Contact and shadow make the ground under an object
look like a part of it to a saliency network; geometry tells them apart. RANSAC (Fischler & Bolles
1981) fits a plane to the points near the object that are not object. The plane counts only when it
holds enough of them and all cameras look down on it; otherwise there is none.

The RANSAC is our own: scikit-image's has no model of a plane, so that a class of this file would
hold all but its loop.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACH = 3.0  # radii of the object within which the plane is fitted
SAMPLE = 4000  # points that are drawn for it
ROUNDS = 500  # a plane that holds a quarter of the points is drawn with probability > 0.999
TOLERANCE = 0.03  # of the object's radius: distance of a point that still lies on the plane
LEAST_SHARE = 0.25  # of the points that the plane must hold
CAMERAS_ABOVE = 0.95
REFITS = 3
FEWEST_POINTS = 50
SEED = 0


@dataclass(frozen=True)
class Plane:
    """Points x with ``normal · x = offset``; the normal [3], of length 1, points to the cameras.

    ``share`` of the surrounding points lies on it.
    """

    normal: Array
    offset: float
    share: float

    def heights(self, points: Array) -> Array:
        """Return the signed distance [N] of points [N, 3], positive towards the cameras."""
        heights: Array = points @ self.normal - self.offset
        return heights


def find(points: Array, radius: float, cameras: Array) -> Plane | None:
    """Return the plane that most of ``points`` [N, 3] lie on, or None where none convinces.

    ``points`` are the object's surroundings, ``radius`` is the object's, ``cameras`` [V, 3] are the
    centres; all in world units.
    """
    if len(points) < FEWEST_POINTS:
        return None
    rng = np.random.default_rng(SEED)
    points = points[rng.permutation(len(points))[:SAMPLE]]
    limit = TOLERANCE * radius
    best, normal, offset = 0, np.zeros(3), 0.0
    for _ in range(ROUNDS):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        across = np.cross(b - a, c - a)
        length = float(np.linalg.norm(across))
        if length == 0:
            continue
        held = int((np.abs((points - a) @ (across / length)) < limit).sum())
        if held > best:
            best, normal = held, across / length
            offset = float(normal @ a)
    if best < FEWEST_POINTS:
        return None
    for _ in range(REFITS):
        held_points = points[np.abs(points @ normal - offset) < limit]
        if len(held_points) < FEWEST_POINTS:
            return None
        middle = held_points.mean(axis=0)
        normal = np.linalg.svd(held_points - middle, full_matrices=False)[2][2]
        offset = float(normal @ middle)
    if np.median(cameras @ normal - offset) < 0:
        normal, offset = -normal, -offset
    share = float((np.abs(points @ normal - offset) < limit).mean())
    above = float((cameras @ normal > offset).mean())
    if share < LEAST_SHARE or above < CAMERAS_ABOVE:
        return None
    return Plane(normal, offset, share)
