"""Lens distortion, removed once so that every later stage sees a pinhole.

Two families of lenses are read, both as COLMAP, OpenCV and nerfstudio write them. With
``r² = x² + y²`` on the normalised image plane:

- Brown–Conrady: ``x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) + 2 p1 x y +
  p2 (r² + 2 x²)`` and ``y'`` likewise with p1 and p2 exchanged;
- fisheye (Kannala & Brandt 2006): ``(x', y') = (x, y) θ / r (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)``
  with ``θ = atan r``.

Pixel centres are at +0.5 here and at 0 in OpenCV's own functions; the shift happens in this module
only.
"""

from dataclasses import dataclass
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Intrinsics
from mattgs_ops.errors import InputError

EDGE_SAMPLES = 257  # points per edge that decide which part of the plane every pixel can be read in
MAX_ZOOM = 3.0  # a valid rectangle smaller than a third of the photo means broken coefficients
# A pinhole that holds all of a wide lens's field has few pixels left for the middle: the edges are
# cropped where the middle would lose more than half of its resolution.
MIN_ZOOM = 0.5
WIDEST_THETA = np.radians(85.0)  # a pinhole's plane has nothing at 90 degrees
THETA_SAMPLES = 4096  # of the table that inverts the fisheye's polynomial; error below 0.001 pixels

# OpenCV's default of five steps is hundreds of pixels off at the corners of a wide lens
UNTIL_EXACT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-10)
MISSED = 0.5  # pixels: farther off, a place on the plane is not the one that the pixel shows
CLOSER = 1.02  # steps by which the pinhole sees less, where a lens folds the plane at its corners

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lens:
    """A camera with distortion.

    ``coefficients`` are (k1, k2, p1, p2, k3, k4, k5, k6) or the first few of these, in OpenCV's
    order; of a ``fisheye`` they are (k1, k2, k3, k4).
    """

    intrinsics: Intrinsics
    coefficients: tuple[float, ...] = ()
    fisheye: bool = False

    @property
    def is_pinhole(self) -> bool:
        """Whether there is nothing to remove."""
        return not self.fisheye and not any(self.coefficients)

    def to_plane(self, pixels: Array) -> Array:
        """Return where pixels [N, 2] lie on the normalised image plane, without distortion.

        Rays of a fisheye more than 85 degrees off the axis are put at 85 degrees.
        """
        i = self.intrinsics
        if not self.fisheye:
            # OpenCV wants at least one point, and four, five or eight coefficients
            matrix = np.array([[i.fx, 0, i.cx], [0, i.fy, i.cy], [0, 0, 1.0]])
            if not len(pixels):
                return np.zeros((0, 2))
            found = cv2.undistortPoints(
                pixels, matrix, _opencv_coefficients(self), criteria=UNTIL_EXACT
            )
            return np.asarray(found[:, 0], dtype=np.float64)
        xy = (pixels - [i.cx, i.cy]) / [i.fx, i.fy]
        radius = np.linalg.norm(xy, axis=1)
        theta, distorted = _theta_table(self)
        slope = np.tan(np.interp(radius, distorted, theta))
        scale = np.divide(slope, radius, out=np.ones_like(radius), where=radius > 0)
        out: Array = xy * scale[:, None]
        return out

    def to_pixels(self, plane: Array) -> Array:
        """Return the pixels [N, 2] that show points [N, 2] of the normalised image plane."""
        i = self.intrinsics
        k = _opencv_coefficients(self)
        x, y = plane[:, 0], plane[:, 1]
        r2 = x * x + y * y
        if self.fisheye:
            r = np.sqrt(r2)
            theta = np.arctan(r)
            scale = np.divide(_distorted(theta, k), r, out=np.ones_like(r), where=r > 0)
            u, v = x * scale, y * scale
        else:
            k1, k2, p1, p2, k3, k4, k5, k6 = k
            radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
            u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            v = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
        return np.stack([i.fx * u + i.cx, i.fy * v + i.cy], axis=1)


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

    def coverage(self, coverage: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Resample shares of a pixel [H, W] (bilinear)."""
        return self._remap(coverage, cv2.INTER_LINEAR)

    def ids(self, ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Resample whole numbers [H, W], each pixel from the nearest; 0 outside."""
        return self._remap(ids, cv2.INTER_NEAREST)

    def _remap(self, image: NDArray[np.uint8], interpolation: int) -> NDArray[np.uint8]:
        border = cv2.BORDER_REPLICATE  # reached by rounding at the very edge only
        out = cv2.remap(image, self.map_x, self.map_y, interpolation, borderMode=border)
        return np.asarray(out, dtype=np.uint8)


def undistortion(lens: Lens) -> Undistortion:
    """Find the pinhole that keeps the photo's size and sees nothing outside the photo.

    The focal lengths are both multiplied by the one smallest zoom that leaves no empty border, at
    least one half, and the principal point moves so that the valid rectangle is centred. Raises
    :class:`InputError` when the coefficients cannot be inverted over the photo.
    """
    old = lens.intrinsics
    left, top, right, bottom = _valid_rectangle(lens)
    zoom = np.inf
    if right > left and bottom > top:  # between the centres of the first and the last pixel
        across, down = old.fx * (right - left), old.fy * (bottom - top)
        zoom = max((old.width - 1) / across, (old.height - 1) / down)
    middle = (left + right) / 2, (top + bottom) / 2
    while zoom < MAX_ZOOM and not _shown_once(lens, middle, zoom):
        zoom *= CLOSER
    if not zoom < MAX_ZOOM:
        raise InputError(
            f"distortion {lens.coefficients}: cannot be undone over a {old.width}x{old.height} "
            "photo; check the coefficients"
        )
    zoom = max(zoom, MIN_ZOOM)
    fx, fy = old.fx * zoom, old.fy * zoom
    cx, cy = old.width / 2 - fx * middle[0], old.height / 2 - fy * middle[1]
    new = Intrinsics(old.width, old.height, fx, fy, cx, cy)
    matrix, coefficients = _opencv(old), _opencv_coefficients(lens)
    size = (old.width, old.height)
    build = cv2.fisheye.initUndistortRectifyMap if lens.fisheye else cv2.initUndistortRectifyMap
    map_x, map_y = build(matrix, coefficients, np.eye(3), _opencv(new), size, cv2.CV_32FC1)
    return Undistortion(new, map_x, map_y)


class Undistortions:
    """Those of the lenses seen so far, for threads that write many photos of few lenses."""

    def __init__(self) -> None:
        self._found: dict[Lens, Undistortion] = {}
        self._lock = Lock()

    def of(self, lens: Lens) -> Undistortion:
        """Return the undistortion of a lens, computed once."""
        with self._lock:
            if lens not in self._found:
                self._found[lens] = undistortion(lens)
            return self._found[lens]


def _shown_once(lens: Lens, middle: tuple[float, float], zoom: float) -> bool:
    """Whether a pinhole's corners are where their pixels show them to be.

    Beyond the radius up to which the distortion grows, the photo shows the same again.
    """
    if lens.fisheye:  # its table ends where the distortion stops growing
        return True
    i = lens.intrinsics
    half = np.array([i.width / i.fx, i.height / i.fy]) / (2 * max(zoom, MIN_ZOOM))
    corners = np.array(middle) + half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    return bool(_exact(lens, lens.to_pixels(corners), corners).all())


def _exact(lens: Lens, pixels: Array, plane: Array) -> NDArray[np.bool_]:
    """Whether pixels [N, 2] show those places [N, 2] of the plane and no others."""
    i = lens.intrinsics
    off = np.abs(lens.to_plane(pixels) - plane) * [i.fx, i.fy]
    there = np.abs(lens.to_pixels(plane) - pixels)
    exact: NDArray[np.bool_] = (np.maximum(off, there) < MISSED).all(axis=1)
    return exact


def _opencv(i: Intrinsics) -> Array:
    return np.array([[i.fx, 0, i.cx - 0.5], [0, i.fy, i.cy - 0.5], [0, 0, 1]])


def _opencv_coefficients(lens: Lens) -> Array:
    """Return all 8 coefficients, 4 of a fisheye: what is not given is 0."""
    out = np.zeros(4 if lens.fisheye else 8)
    out[: len(lens.coefficients)] = lens.coefficients
    return out


def _distorted(theta: Array, k: Array) -> Array:
    t2 = theta * theta
    out: Array = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
    return out


def _theta_table(lens: Lens) -> tuple[Array, Array]:
    """Return angles off the axis and their radii on the photo, as far as both grow together."""
    theta = np.linspace(0, WIDEST_THETA, THETA_SAMPLES)
    radius = _distorted(theta, _opencv_coefficients(lens))
    falling = np.flatnonzero(np.diff(radius) <= 0)
    end = int(falling[0]) + 1 if len(falling) else len(theta)
    return theta[:end], radius[:end]


def _valid_rectangle(lens: Lens) -> tuple[float, float, float, float]:
    """Largest axis-parallel rectangle of the undistorted plane inside all four photo edges."""
    width, height = lens.intrinsics.width, lens.intrinsics.height
    # centres of the outermost pixels, at half a pixel from the photo's edge
    right, bottom = width - 0.5, height - 0.5
    across, down = np.linspace(0.5, right, EDGE_SAMPLES), np.linspace(0.5, bottom, EDGE_SAMPLES)
    edges = {
        "left": np.stack([np.full_like(down, 0.5), down], 1),
        "right": np.stack([np.full_like(down, right), down], 1),
        "top": np.stack([across, np.full_like(across, 0.5)], 1),
        "bottom": np.stack([across, np.full_like(across, bottom)], 1),
    }
    plane = {name: _on_plane(lens, pixels) for name, pixels in edges.items()}
    if not all(map(len, plane.values())):
        return 0.0, 0.0, 0.0, 0.0
    return (
        float(plane["left"][:, 0].max()),
        float(plane["top"][:, 1].max()),
        float(plane["right"][:, 0].min()),
        float(plane["bottom"][:, 1].min()),
    )


def _on_plane(lens: Lens, pixels: Array) -> Array:
    """Return where pixels lie on the plane, without those that a lens that folds it cannot show."""
    plane = lens.to_plane(pixels)
    return plane if lens.fisheye else plane[_exact(lens, pixels, plane)]
