"""Haze: splats that hang in the air before a held-out camera, where no surface can be.

No training view says that the air before a held-out camera is clear, and splats that look like
background from the other side may stay there as a half-transparent cloud: one view of six loses
many decibels then, and takes a mean along. The test needs no eye and no truth. Sparse points are
surfaces that several training photos saw. Nearer than :data:`AIR` of the way to the nearest of them
that lie in a view's frame (a low quantile: single points err) there is nothing but air. What the
splats there alone would cover of a view is its haze: their opacity, blended front to back, 0 to 1.
"""

import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, in_frame
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import render
from mattgs_ops.splat.training.optimise import select

AIR = 0.5  # of the way to the nearest points: nothing real is twice as near as they are
NEAREST = 0.01  # share of the points in the frame that may be wrong and too near
FEWEST_POINTS = 100  # in the frame; with fewer nobody knows where surfaces begin
BLACK = (0.0, 0.0, 0.0)


def depth_of_air(points: NDArray[np.float64], camera: Camera) -> float | None:
    """Return the depth up to which a view has nothing but air, in world units.

    ``points`` [P, 3] are on surfaces. None where too few of them lie in the frame.
    """
    places, depths = camera.project(points)
    framed = in_frame(places, depths, (camera.intrinsics.width, camera.intrinsics.height))
    if int(framed.sum()) < FEWEST_POINTS:
        return None
    return AIR * float(np.quantile(depths[framed], NEAREST))


def haze_map(
    splats: Splats, camera: Camera, points: NDArray[np.float64], *, threads: int = 1
) -> NDArray[np.float32] | None:
    """Return how much of each pixel splats in the air cover [H, W] in [0, 1]; None: not known."""
    limit = depth_of_air(points, camera)
    if limit is None:
        return None
    depths = camera.depths(splats.means.numpy().astype(np.float64))
    near = torch.from_numpy(np.flatnonzero((depths > 0) & (depths < limit)))
    size = camera.intrinsics
    if not len(near):
        return np.zeros((size.height, size.width), np.float32)
    with torch.no_grad():
        shown = render(
            select(splats, near), camera, BLACK, sh_degree=0, threads=threads, differentiable=False
        )
    cover: NDArray[np.float32] = shown.alpha.clamp(0, 1).numpy()
    return cover
