"""Whether splats can be trained in the units and about the origin of cameras that came along.

3DGS draws nothing nearer to a camera than 0.2 units (``NEAR_PLANE``, Kerbl et al.'s release), and
splats are 32-bit floats. Cameras given in metres about a small thing, or in coordinates of a
survey, would be trained to nothing without a word.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, in_frame
from mattgs_ops.errors import InputError

NEAR_PLANE = 0.2  # as in splat/_kernels/engine.h
MOST_NEARER = 0.05  # of what cameras see: single points may be wrong
# A float has 24 bits: this far out its steps are a ten-thousandth of what the cameras span
FARTHEST = 1000.0
WELL_BEYOND = 10.0  # times the near plane: where a scene is proposed to lie


def check_units(name: str, cameras: Sequence[Camera], xyz: NDArray[np.float64]) -> None:
    """Check given cameras and what they see, points [N, 3].

    Raises :class:`InputError` that says by what to multiply, or what to subtract.
    """
    if not cameras:
        return
    depths = [_seen(camera, xyz) for camera in cameras]
    seen = np.concatenate(depths)
    nearer = float((seen < NEAR_PLANE).mean()) if len(seen) else 0.0
    if nearer > MOST_NEARER:
        factor = 10.0 ** np.ceil(np.log10(WELL_BEYOND * NEAR_PLANE / np.median(seen)))
        raise InputError(
            f"{name}: {nearer:.0%} of what its cameras see is nearer than {NEAR_PLANE} units, "
            f"where no splat is drawn; multiply camera positions and points by {factor:g}, or have "
            'poses estimated (sfm.poses = "estimate")'
        )
    centres = np.array([camera.centre for camera in cameras])
    middle = np.median(centres, axis=0)
    span = max(float(np.linalg.norm(centres - middle, axis=1).max()), NEAR_PLANE)
    away = float(np.linalg.norm(middle))
    if away > FARTHEST * span:
        raise InputError(
            f"{name}: its cameras span {span:.3g} units, {away:.3g} units from the origin, too far "
            f"for 32-bit numbers; subtract {np.round(middle).tolist()} from camera positions and "
            'points, or have poses estimated (sfm.poses = "estimate")'
        )


def _seen(camera: Camera, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depths of points in the camera's frame."""
    pixels, depths = camera.project(xyz)
    lens = camera.intrinsics
    seen = in_frame(pixels, depths, (lens.width, lens.height))
    return np.asarray(depths[seen], dtype=np.float64)
