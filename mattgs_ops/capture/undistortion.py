"""Lens distortion, removed once so that every later stage sees a pinhole.

The model is Brown–Conrady as COLMAP, OpenCV and nerfstudio write it: with ``r² = x² + y²`` on the
normalised image plane, ``x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)`` and
``y'`` likewise with p1 and p2 exchanged. Pixel centres are at +0.5 here and at 0 in OpenCV's own
functions; the shift happens in this module only.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Intrinsics
from mattgs_ops.errors import InputError

EDGE_SAMPLES = 257  # points per edge that decide which part of the plane every pixel can be read in
MAX_ZOOM = 3.0  # a valid rectangle smaller than a third of the photo means broken coefficients


@dataclass(frozen=True)
class Lens:
    """A camera with distortion: ``coefficients`` are (k1, k2, p1, p2, k3)."""

    intrinsics: Intrinsics
    coefficients: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def is_pinhole(self) -> bool:
        """Whether there is nothing to remove."""
        return not any(self.coefficients)


@dataclass(frozen=True)
class Undistortion:
    """A pinhole of the photo's size, and where each of its pixels lies in the photo.

    ``map_x`` and ``map_y`` are [H, W] float32 in OpenCV's convention (pixel centre at 0).
    """

    intrinsics: Intrinsics
    map_x: NDArray[np.float32]
    map_y: NDArray[np.float32]

    def photo(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Resample a photo [H, W, 3] (bicubic)."""
        return self._remap(rgb, cv2.INTER_CUBIC)

    def mask(self, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Resample a mask [H, W] of 0 and 255 (bilinear, thresholded at half)."""
        soft = self._remap(mask, cv2.INTER_LINEAR)
        return np.where(soft >= 128, 255, 0).astype(np.uint8)

    def ids(self, ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Resample whole numbers [H, W], each pixel from the nearest; 0 outside."""
        return self._remap(ids, cv2.INTER_NEAREST)

    def _remap(self, image: NDArray[np.uint8], interpolation: int) -> NDArray[np.uint8]:
        border = cv2.BORDER_REPLICATE  # reached by rounding at the very edge only
        out = cv2.remap(image, self.map_x, self.map_y, interpolation, borderMode=border)
        return np.asarray(out, dtype=np.uint8)


def undistortion(lens: Lens) -> Undistortion:
    """Find the pinhole that keeps the photo's size and sees nothing outside the photo.

    The focal lengths are both multiplied by the one smallest zoom that leaves no empty border, and
    the principal point moves so that the valid rectangle is centred. Raises :class:`InputError`
    when the coefficients cannot be inverted over the photo.
    """
    old = lens.intrinsics
    left, top, right, bottom = _valid_rectangle(lens)
    zoom = np.inf
    if right > left and bottom > top:  # between the centres of the first and the last pixel
        across, down = old.fx * (right - left), old.fy * (bottom - top)
        zoom = max((old.width - 1) / across, (old.height - 1) / down)
    if not zoom < MAX_ZOOM:
        raise InputError(
            f"distortion {lens.coefficients}: cannot be undone over a {old.width}x{old.height} "
            "photo; check the coefficients"
        )
    fx, fy = old.fx * zoom, old.fy * zoom
    cx = old.width / 2 - fx * (left + right) / 2
    cy = old.height / 2 - fy * (top + bottom) / 2
    new = Intrinsics(old.width, old.height, fx, fy, cx, cy)
    matrix, coefficients = _opencv(old), np.array(lens.coefficients)
    map_x, map_y = cv2.initUndistortRectifyMap(
        matrix, coefficients, np.eye(3), _opencv(new), (old.width, old.height), cv2.CV_32FC1
    )
    return Undistortion(new, map_x, map_y)


def _opencv(i: Intrinsics) -> NDArray[np.float64]:
    return np.array([[i.fx, 0, i.cx - 0.5], [0, i.fy, i.cy - 0.5], [0, 0, 1]])


def _valid_rectangle(lens: Lens) -> tuple[float, float, float, float]:
    """Largest axis-parallel rectangle of the undistorted plane inside all four photo edges."""
    width, height = lens.intrinsics.width, lens.intrinsics.height
    across, down = np.linspace(0, width - 1, EDGE_SAMPLES), np.linspace(0, height - 1, EDGE_SAMPLES)
    edges = {
        "left": np.stack([np.zeros_like(down), down], 1),
        "right": np.stack([np.full_like(down, width - 1), down], 1),
        "top": np.stack([across, np.zeros_like(across)], 1),
        "bottom": np.stack([across, np.full_like(across, height - 1)], 1),
    }
    matrix, coefficients = _opencv(lens.intrinsics), np.array(lens.coefficients)
    plane = {k: cv2.undistortPoints(v, matrix, coefficients)[:, 0] for k, v in edges.items()}
    return (
        float(plane["left"][:, 0].max()),
        float(plane["top"][:, 1].max()),
        float(plane["right"][:, 0].min()),
        float(plane["bottom"][:, 1].min()),
    )
