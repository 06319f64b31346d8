"""Pinhole cameras in COLMAP's convention.

World-to-camera, x right, y down, z forward; lengths of the image plane in pixels; the centre of
the top-left pixel is at (0.5, 0.5). Lens distortion is removed before a :class:`Camera` is made.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole without distortion: ``u = fx * x / z + cx``, ``v = fy * y / z + cy``."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def scaled(self, width: int, height: int) -> "Intrinsics":
        """Return the intrinsics of the same photo resized to ``width`` × ``height`` pixels."""
        sx, sy = width / self.width, height / self.height
        return Intrinsics(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)


@dataclass(frozen=True)
class Camera:
    """One posed pinhole view.

    ``rotation`` [3, 3] and ``translation`` [3] map world to camera: ``x_cam = R @ x + t``.
    """

    intrinsics: Intrinsics
    rotation: Array
    translation: Array

    @property
    def centre(self) -> Array:
        """The camera's position in the world, [3]."""
        return -self.rotation.T @ self.translation

    @property
    def matrix(self) -> Array:
        """World-to-camera as a homogeneous matrix, [4, 4]."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.rotation, self.translation
        return out

    def scaled(self, width: int, height: int) -> "Camera":
        """Return this camera for the same photo resized to ``width`` × ``height`` pixels."""
        return Camera(self.intrinsics.scaled(width, height), self.rotation, self.translation)

    def depths(self, points: Array) -> Array:
        """Return the depths of world points [N, 3] along the camera's axis, [N]; may be <= 0."""
        found: Array = points @ self.rotation[2] + self.translation[2]
        return found

    def project(self, points: Array) -> tuple[Array, Array]:
        """Project world points [N, 3] to pixels [N, 2] and depths [N] (camera z, may be <= 0)."""
        # a row for each coordinate: twenty times as fast as a row for each point
        x, y, depth = self.rotation @ points.T + self.translation[:, None]
        i = self.intrinsics
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = np.stack([x / depth * i.fx + i.cx, y / depth * i.fy + i.cy], axis=-1)
        return pixels, depth


def sizes_of_their_own(sizes: Sequence[tuple[int, int]]) -> list[int]:
    """Return the places of sizes (width, height) that no other has, either way up."""
    counts = Counter(tuple(sorted(size)) for size in sizes)
    return [place for place, size in enumerate(sizes) if counts[tuple(sorted(size))] == 1]


def in_frame(
    pixels: Array, depths: Array, size: tuple[int, int], *, beyond: float = 0.0
) -> NDArray[np.bool_]:
    """Say which projections [N, 2] with depth [N] lie before the camera and inside the frame.

    ``size`` is the frame's width and height; depths up to ``beyond`` do not count. A pixel that is
    not a number lies nowhere.
    """
    x, y = pixels.T.copy()  # columns that lie side by side are compared three times as fast
    width, height = size
    with np.errstate(invalid="ignore"):
        inside: NDArray[np.bool_] = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        return inside & (depths > beyond)


def from_opengl(camera_to_world: Array) -> tuple[Array, Array]:
    """Turn an OpenGL camera-to-world matrix [4, 4] (x right, y up, z back) into (R, t).

    This is the convention of nerfstudio's and NeRF's ``transforms.json``.
    """
    flipped = camera_to_world[:3, :3] * [1.0, -1.0, -1.0]
    rotation = flipped.T
    return rotation, -rotation @ camera_to_world[:3, 3]


def rotation_of(quaternion: Array) -> Array:
    """Turn a wxyz quaternion [4] of any length but zero into a rotation matrix [3, 3]."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: Array) -> Array:
    """Turn a rotation matrix [3, 3] into a unit quaternion wxyz with w >= 0.

    The quaternion is the eigenvector of the largest eigenvalue of Bar-Itzhack's 4×4 matrix
    (2000), which stays accurate for half turns where formulas by the trace do not.
    """
    r = rotation
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], 0.0, 0.0, 0.0],
            [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], 0.0, 0.0],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0.0],
            [
                r[1, 0] - r[0, 1],
                r[0, 2] + r[2, 0],
                r[1, 2] + r[2, 1],
                r[2, 2] - r[0, 0] - r[1, 1],
            ],
        ]
    )
    _, vectors = np.linalg.eigh(k)  # reads the lower triangle; eigenvalues ascend
    q: Array = vectors[:, -1]
    return -q if q[0] < 0 else q
