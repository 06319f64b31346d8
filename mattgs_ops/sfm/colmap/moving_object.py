"""Whether the object moves against what surrounds it, as on a turntable before a camera.

Whole photos then show two motions. Poses that follow the surroundings, or mix both, are wrong for
the object, and nothing in a reconstruction's own numbers says so. The object's matches, those
between key points inside masks, say so: a pair *contradicts* the geometry of its whole photos when
a geometry of the object alone explains more than twice as many of them. Worker process only.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.sfm.colmap.features import Matches, Pair

Floats = NDArray[np.float64]

# Matches that a geometry of the object needs: COLMAP's default for placing a view. Parts
# that repeat, such as legs, match wrongly with 15 to 30 in a third of the hexapod's pairs.
FEWEST_MATCHES = 30
STANDS_STILL = "most matches do not move"  # how the fallback begins of a camera that stands still
LARGEST_ERROR = 4.0  # pixels from an epipolar line: COLMAP's default of two views' geometry
# Of the pairs that show the object and whose views are placed: right poses explain 0.95 and 1 on
# bundled captures, which stand still. Below this share poses from the object alone are tried.
MOST_EXPLAINED = 0.75


@dataclass(frozen=True)
class ObjectMatches:
    """A pair's matches on the object [M, 2].

    ``contradicts``: the geometry of the whole photos does not explain them.
    """

    matches: Matches
    contradicts: bool


def object_matches(
    matches: Matches,
    inliers: Matches,
    inside: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    verify: Callable[[Matches], Matches],
) -> ObjectMatches | None:
    """Return what a pair's matches say of the object; None where they are too few.

    ``inliers`` [N, 2] are those of all ``matches`` [M, 2] that the whole photos' geometry explains;
    ``inside`` says of both views' key points whether they lie on the object. ``verify`` returns
    the inliers of a geometry of its own. It is asked only where the whole photos' explains less
    than half of the object's matches.
    """
    its, explained = (m[inside[0][m[:, 0]] & inside[1][m[:, 1]]] for m in (matches, inliers))
    if 2 * len(explained) >= len(its):
        enough = len(explained) >= FEWEST_MATCHES
        return ObjectMatches(explained, contradicts=False) if enough else None
    own = verify(its) if len(its) >= FEWEST_MATCHES else its[:0]
    if len(own) < FEWEST_MATCHES:
        return None
    rows = {tuple(match) for match in explained.tolist()}
    shared = sum(tuple(match) in rows for match in own.tolist())
    return ObjectMatches(own, contradicts=2 * shared < len(own))


def share_contradicting(found: Mapping[Pair, ObjectMatches]) -> float | None:
    """Return the share of pairs that contradict their whole photos; None where there is no pair."""
    return sum(one.contradicts for one in found.values()) / len(found) if found else None


def shares_explained(
    found: Mapping[Pair, ObjectMatches],
    cameras: Mapping[int, Camera],
    rays: Callable[[int, NDArray[np.uint32]], Floats],
) -> tuple[float | None, float | None]:
    """Return the shares of pairs of which poses explain half of the object's matches.

    Of all pairs, where one with a view that has no pose is not explained; and of those whose views
    both have one. ``cameras`` are the views that have a pose, ``rays`` returns key points of a
    view, named by their rows, on its normalised image plane. None without any pair.
    """
    placed = [pair for pair in found if set(pair) <= set(cameras)]
    count = sum(explained(pair, found[pair].matches, cameras, rays) for pair in placed)
    of_all, of_placed = (count / n if n else None for n in (len(found), len(placed)))
    return of_all, of_placed


def explained(
    pair: Pair,
    matches: Matches,
    cameras: Mapping[int, Camera],
    rays: Callable[[int, NDArray[np.uint32]], Floats],
) -> bool:
    """Whether half of a pair's matches [M, 2] lie on its cameras' epipolar lines, or more."""
    here, there = (rays(view, matches[:, side]) for side, view in enumerate(pair))
    error = epipolar_error(cameras[pair[0]], cameras[pair[1]], here, there)
    return 2 * int((error < LARGEST_ERROR).sum()) >= len(error)


def explains_more(alone: float | None, whole: float | None) -> bool:
    """Whether poses from the object alone are taken: they leave at most half as much unexplained.

    Both are shares of pairs (:func:`shares_explained`), None where no poses were found.
    """
    if alone is None or whole is None:
        return alone is not None
    return 2 * (1 - alone) <= 1 - whole


def epipolar_error(first: Camera, second: Camera, here: Floats, there: Floats) -> Floats:
    """Return Sampson's distance [M] in pixels of matches from two poses' epipolar geometry.

    ``here`` and ``there`` [M, 2] are matches on the normalised image planes of both cameras.
    Infinite where the cameras stand in one place. Hartley and Zisserman 2004, eq. 11.9.
    """
    rotation = second.rotation @ first.rotation.T
    x, y, z = second.translation - rotation @ first.translation
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    one, other = (np.pad(rays, ((0, 0), (0, 1)), constant_values=1.0) for rays in (here, there))
    lines, back = one @ essential.T, other @ essential
    steepness = (lines[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)
    distance = np.abs((other * lines).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(steepness > 0, distance / np.sqrt(steepness), np.inf)
    focal = np.mean([camera.intrinsics.fx for camera in (first, second)])
    return np.asarray(error * focal, dtype=np.float64)
