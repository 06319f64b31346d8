"""The first splats: from the sparse points, or from a stated random start where they are too few.

As in 3DGS: the point's colour is the constant SH coefficient, the extent is the distance to the
three nearest neighbours (root mean square, as the release has it; the paper says mean), opacity
is 0.1, the rotation none.

``nobg`` starts from the points of the object alone: those that lie inside the mask in at least
80 % of the views that see them. Where fewer than 100 points are left (for ``original`` of all
points), 10,000 points are drawn at random, seeded, in the volume the cameras share and, for
``nobg``, in the masks' visual hull (:mod:`mattgs_ops.capture.visual_hull`). Cameras, masks and
colours come from training views only.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mattgs_ops.capture import visual_hull
from mattgs_ops.capture.camera import Camera, in_frame
from mattgs_ops.capture.scene import SparsePoints
from mattgs_ops.capture.sparse import are_on_object
from mattgs_ops.errors import StageError
from mattgs_ops.frozen import Background
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_CONSTANT
from mattgs_ops.splat.photos import StoredView

Array = NDArray[np.float64]

START_OPACITY = 0.1  # Kerbl et al. 2023, released code
NEIGHBOURS = 3
SMALLEST_SQUARED = 1e-7  # squared distance: coincident points would have no extent at all
FEWEST_POINTS = 100
RANDOM_POINTS = 10_000
HALF_COVERED = 128  # of 255: from here on a mask's pixel counts as object
EXTENT_MARGIN = 1.1  # as in 3DGS's getNerfppNorm


@dataclass(frozen=True)
class StartingPoints:
    """Where training starts: ``xyz`` [P, 3] float64, ``rgb`` [P, 3] float64 in [0, 1].

    ``source`` names where they come from, for the report.
    """

    xyz: Array
    rgb: Array
    source: Literal["sparse", "random"]

    def keep(self, chosen: NDArray[np.bool_]) -> "StartingPoints":
        """Return the ``chosen`` [P] points."""
        return replace(self, xyz=self.xyz[chosen], rgb=self.rgb[chosen])

    def at_most(self, count: int, seed: int) -> "StartingPoints":
        """Return all points, or ``count`` drawn from them without order where there are more."""
        if len(self.xyz) <= count:
            return self
        chosen = np.zeros(len(self.xyz), dtype=np.bool_)
        chosen[np.random.default_rng(seed).permutation(len(chosen))[:count]] = True
        return self.keep(chosen)


def starting_points(
    points: SparsePoints, views: Sequence[StoredView], background: Background, seed: int
) -> StartingPoints:
    """Choose the points that training starts from; ``views`` are the training views.

    Raises :class:`StageError` when there are too few points and the cameras share no volume.
    """
    chosen = np.isfinite(points.xyz).all(axis=1)
    if background == "nobg":
        chosen &= are_on_object(points)
    if int(chosen.sum()) >= FEWEST_POINTS:
        return StartingPoints(
            points.xyz[chosen].astype(np.float64), points.rgb[chosen] / 255.0, "sparse"
        )
    xyz = _random_points(views, background, np.random.default_rng(seed))
    return StartingPoints(xyz, _mean_colours(xyz, views), "random")


def initial_splats(
    points: StartingPoints, *, opacity: float = START_OPACITY, scale: float = 1.0
) -> Splats:
    """Turn points into splats; two points at least, for a neighbour to measure from.

    ``scale`` is times the distance to the neighbours.
    """
    count = len(points.xyz)
    if count < 2:
        raise StageError(f"training needs two starting points at least, found {count}")
    tree = cKDTree(points.xyz)
    distances, _ = tree.query(points.xyz, k=min(NEIGHBOURS, count - 1) + 1)
    squared = np.maximum((distances[:, 1:] ** 2).mean(axis=1), SMALLEST_SQUARED)
    log_scale = np.log(scale * np.sqrt(squared))
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    logit = np.log(opacity / (1 - opacity))
    return Splats(
        means=_floats(points.xyz),
        log_scales=_floats(np.repeat(log_scale[:, None], 3, axis=1)),
        quaternions=_floats(identity),
        opacity_logits=_floats(np.full(count, logit)),
        sh_dc=_floats((points.rgb - 0.5) / SH_CONSTANT),
        sh_rest=torch.zeros(count, 15, 3),
    )


def scene_extent(cameras: Sequence[Camera]) -> float:
    """Return 3DGS's scale of a scene: the farthest camera from their mean, times 1.1.

    In world units. Raises :class:`StageError` when all cameras are in one place.
    """
    centres = np.array([camera.centre for camera in cameras])
    extent = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
    if not extent > 0:
        raise StageError(
            f"{len(cameras)} training view(s), all from one place: expected cameras that differ"
        )
    return extent * EXTENT_MARGIN


def _random_points(
    views: Sequence[StoredView], background: Background, rng: np.random.Generator
) -> Array:
    masks = [(view.mask >= HALF_COVERED).astype(np.uint8) for view in views]
    cameras = [view.camera for view in views]
    used = masks if background == "nobg" else None
    points = visual_hull.sample(cameras, used, RANDOM_POINTS, rng)
    if len(points) < FEWEST_POINTS:
        raise StageError(
            f"too few sparse points, and the {len(views)} training cameras share no volume to "
            f"draw random ones in: expected {FEWEST_POINTS} points, found {len(points)}"
        )
    return points


def _mean_colours(points: Array, views: Sequence[StoredView]) -> Array:
    """Mean colour [P, 3] in [0, 1] over the views that see a point, occluded or not."""
    total = np.zeros((len(points), 3))
    seen = np.zeros(len(points))
    for view in views:
        visible, columns, rows = _pixels_of(points, view)
        total[visible] += view.image[rows, columns]
        seen += visible
    return total / np.maximum(seen, 1)[:, None] / 255.0


def _pixels_of(
    points: Array, view: StoredView
) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    """Return who is in the frame [P], and the columns and rows of those that are."""
    pixels, depth = view.camera.project(points)
    height, width = view.mask.shape
    visible = in_frame(pixels, depth, (width, height))
    cells = pixels[visible].astype(np.int64)
    return visible, cells[:, 0], cells[:, 1]


def _floats(values: Array) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
