"""How far estimated camera poses are from known ones, after the best similarity.

Structure-from-motion fixes neither the world's origin, axes nor scale; poses are comparable only
after the similarity that brings the estimated camera centres closest to the true ones
(Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
PAMI 1991, eqs. 40–42).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.errors import InputError

Array = NDArray[np.float64]
LEAST_POINTS = 3  # a similarity in space is fixed by three points that are not on one line
ON_A_LINE = 1e-6  # ratio of the second to the first singular value: rounding of float32 poses


@dataclass(frozen=True)
class Similarity:
    """``y = scale * rotation @ x + translation``; rotation [3, 3], translation [3]."""

    scale: float
    rotation: Array
    translation: Array

    def apply(self, points: Array) -> Array:
        """Map points [N, 3]."""
        out: Array = self.scale * points @ self.rotation.T + self.translation
        return out


@dataclass(frozen=True)
class PoseError:
    """Differences of poses after alignment.

    Rotations are in degrees; positions are shares of the orbit's radius, the root mean square
    distance of the true camera centres from their mean. ``focal`` is the mean of
    ``estimated / true - 1``.
    """

    views: int
    rotation_deg_mean: float
    rotation_deg_max: float
    position_mean: float
    position_max: float
    focal: float


def similarity(source: Array, target: Array) -> Similarity:
    """Return the least-squares similarity that maps ``source`` [N, 3] onto ``target`` [N, 3].

    Raises :class:`InputError` for fewer than three points or points on one line.
    """
    if source.shape != target.shape or len(source) < LEAST_POINTS:
        raise InputError(
            f"alignment: expected two equal lists of at least {LEAST_POINTS} points, found "
            f"{len(source)} and {len(target)}"
        )
    for points in (source, target):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] <= ON_A_LINE * max(spread[0], np.finfo(np.float64).tiny):
            raise InputError("alignment: expected points that are not all on one line")
    from skimage.transform import SimilarityTransform  # half of what starting COLMAP's process took

    found = SimilarityTransform.from_estimate(source, target)
    scale = float(found.scale)
    return Similarity(scale, found.params[:3, :3] / scale, found.params[:3, 3])


def pose_error(estimated: Mapping[str, Camera], truth: Mapping[str, Camera]) -> PoseError:
    """Compare the poses of the views that both know, by name.

    Raises :class:`InputError` when fewer than three views are shared.
    """
    names = sorted(set(estimated) & set(truth))
    ours, theirs = [estimated[n] for n in names], [truth[n] for n in names]
    centres = np.array([c.centre for c in ours]).reshape(-1, 3)
    targets = np.array([c.centre for c in theirs]).reshape(-1, 3)
    best = similarity(centres, targets)
    radius = float(np.sqrt(((targets - targets.mean(axis=0)) ** 2).sum(axis=1).mean()))
    position = np.linalg.norm(best.apply(centres) - targets, axis=1) / radius
    rotation = np.array(
        [
            angle_between(a.rotation @ best.rotation.T, b.rotation)
            for a, b in zip(ours, theirs, strict=True)
        ]
    )
    focal = [a.intrinsics.fx / b.intrinsics.fx - 1 for a, b in zip(ours, theirs, strict=True)]
    return PoseError(
        len(names),
        float(rotation.mean()),
        float(rotation.max()),
        float(position.mean()),
        float(position.max()),
        float(np.mean(focal)),
    )


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two rotations [3, 3], degrees; exact for tiny angles too."""
    # |a - b|_F = 2 sqrt(2) sin(angle / 2), well conditioned where the arc cosine is not
    chord = np.linalg.norm(a - b) / (2 * np.sqrt(2))
    return float(np.degrees(2 * np.arcsin(min(1.0, float(chord)))))
