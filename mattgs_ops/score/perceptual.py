"""How different two images look: ꟻLIP (Andersson et al. 2020).

ꟻLIP models what a viewer sees who flips between rendering and truth: colour differences, edges and
points, each filtered by what an eye resolves at a distance. No weights, no training. Its authors'
library, ``flip-evaluator``, is the reference that a test compares with; it takes six times as long.
Filters are applied as rows and columns, in float32, as the library does; outside the frame the
outermost pixel goes on.

Colours pass through three spaces: linear RGB; YCxCz, in which contrast sensitivity is known;
CIELab, in which a difference is a number. Constants are the paper's.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError

Image = NDArray[np.floating]
Floats = NDArray[np.float32]
Kernel = NDArray[np.float64]

# The library's default: a display of 0.7 m with 3,840 pixels across, seen from 0.7 m
PIXELS_PER_DEGREE = 3840 * np.pi / 180
# Contrast sensitivity to Y, Cx and Cz, each a sum of Gaussians (height, width in degrees²)
SENSITIVITY = (((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
FEATURE_WIDTH = 0.082  # degrees, of edges and points that the eye detects
REACH = 3  # standard deviations of a filter that count
COLOUR_POWER, FEATURE_POWER = 0.7, 0.5
# Up to this share of the largest colour difference, errors are spread over this part of [0, 1]
KNEE, BELOW_KNEE = 0.4, 0.95
# sRGB's primaries to CIE XYZ, relative to the white that they make together
TO_XYZ = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
TO_XYZ /= TO_XYZ.sum(axis=1, keepdims=True)
# XYZ to YCxCz, to which -16 is added in Y; CIELab's with a cube root in between
OPPONENT = np.array([[0, 116.0, 0], [500, -500, 0], [0, 200, -200]])
LIGHTNESS_OFFSET = -16.0
LAB_LINEAR = (6 / 29) ** 3  # below it CIELab's cube root is replaced by a line


@dataclass(frozen=True)
class _Filters:
    """Rows of separable filters: Gaussians for Y, Cx and Cz, and those that find features."""

    sensitivity: tuple[tuple[Kernel, ...], ...]
    smooth: Kernel
    edge: Kernel
    point: Kernel


def flip_map(image: Image, truth: Image) -> NDArray[np.float64]:
    """Return ꟻLIP at each pixel, [H, W] in [0, 1]: 0 looks the same, 1 could not differ more.

    Images are [H, W, 3] in [0, 1], sRGB as stored. Raises :class:`InputError` for images of
    different sizes.
    """
    if image.shape != truth.shape or image.ndim != 3:
        raise InputError(f"expected two images of one size, found {image.shape} and {truth.shape}")
    seen, wanted = _opponent(image), _opponent(truth)
    colour = _distance(_perceived(seen), _perceived(wanted)) ** np.float32(COLOUR_POWER)
    largest = _largest_distance() ** COLOUR_POWER
    knee = KNEE * largest
    spread = BELOW_KNEE + (colour - knee) / (largest - knee) * (1 - BELOW_KNEE)
    colour = np.where(colour < knee, colour * np.float32(BELOW_KNEE / knee), spread)
    features = [np.abs(a - b) for a, b in zip(_features(seen), _features(wanted), strict=True)]
    feature = (np.maximum(*features) / np.float32(np.sqrt(2))) ** np.float32(FEATURE_POWER)
    errors: NDArray[np.float64] = (colour ** (1 - feature)).astype(np.float64)
    return errors


def _opponent(image: Image) -> Floats:
    """Return sRGB [H, W, 3] as YCxCz."""
    stored = np.asarray(image, dtype=np.float32)
    power = ((stored + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    linear = np.where(stored <= np.float32(0.04045), stored / np.float32(12.92), power)
    offset = np.array([[LIGHTNESS_OFFSET], [0], [0]])
    return np.asarray(cv2.transform(linear, np.hstack([OPPONENT @ TO_XYZ, offset])))


def _perceived(opponent: Floats) -> Floats:
    """Return what an eye resolves of YCxCz [H, W, 3], as lightness and chroma that it dims."""
    blurred = [
        sum(_filtered(channel, row, row) for row in rows)
        for channel, rows in zip(cv2.split(opponent), _filters().sensitivity, strict=True)
    ]
    back = np.linalg.inv(OPPONENT @ TO_XYZ)
    offset = -back @ [[LIGHTNESS_OFFSET], [0], [0]]
    linear = cv2.transform(cv2.merge(blurred), np.hstack([back, offset]))
    return _lab_hunt(np.clip(linear, 0, 1))


def _lab_hunt(linear: Floats) -> Floats:
    """Return linear RGB [H, W, 3] as CIELab, a and b dimmed with lightness (Hunt's effect)."""
    xyz = cv2.transform(linear, TO_XYZ)
    line = xyz * np.float32(LAB_LINEAR ** (-2 / 3) / 3) + np.float32(4 / 29)
    root = np.where(xyz > np.float32(LAB_LINEAR), np.cbrt(xyz), line)
    offset = np.array([[LIGHTNESS_OFFSET], [0], [0]])
    lab: Floats = cv2.transform(root, np.hstack([OPPONENT, offset]))
    lab[..., 1:] *= np.float32(0.01) * lab[..., :1]
    return lab


def _distance(one: Floats, other: Floats) -> Floats:
    """Return HyAB, which suits large differences: that of lightness plus that of chroma."""
    lightness, a, b = cv2.split(one - other)
    return np.asarray(np.abs(lightness) + _length(a, b), dtype=np.float32)


@lru_cache(maxsize=1)
def _largest_distance() -> float:
    """Return the largest distance of two colours, that of green and blue."""
    green, blue = (_lab_hunt(np.eye(3, dtype=np.float32)[None, None, i]) for i in (1, 2))
    return float(_distance(green, blue)[0, 0])


def _features(opponent: Floats) -> tuple[Floats, Floats]:
    """Return how much of an edge and of a point each pixel of YCxCz [H, W, 3] is, [H, W]."""
    filters = _filters()
    lightness = (opponent[..., 0] - np.float32(LIGHTNESS_OFFSET)) / np.float32(OPPONENT[0, 1])
    edge, point = (
        _length(
            _filtered(lightness, row, filters.smooth), _filtered(lightness, filters.smooth, row)
        )
        for row in (filters.edge, filters.point)
    )
    return edge, point


def _length(x: Floats, y: Floats) -> Floats:
    """Return the length of vectors; OpenCV's rounds as the place in memory has it."""
    return np.asarray(np.sqrt(x * x + y * y))


def _filtered(channel: Floats, row: Kernel, column: Kernel) -> Floats:
    return np.asarray(cv2.sepFilter2D(channel, -1, row, column, borderType=cv2.BORDER_REPLICATE))


@lru_cache(maxsize=1)
def _filters() -> _Filters:
    widest = max(width for terms in SENSITIVITY for _, width in terms)
    deviation = np.sqrt(widest / 2) / np.pi * PIXELS_PER_DEGREE
    square = (_places(deviation) / PIXELS_PER_DEGREE) ** 2
    sensitivity = []
    for terms in SENSITIVITY:
        # the root of a height twice, in rows and in columns, is that of the paper's filter
        rows = [
            np.sqrt(height * np.sqrt(np.pi / width)) * np.exp(-(np.pi**2) * square / width)
            for height, width in terms
        ]
        whole = np.sqrt(sum(row.sum() ** 2 for row in rows))
        sensitivity.append(tuple(row / whole for row in rows))
    deviation = FEATURE_WIDTH / 2 * PIXELS_PER_DEGREE
    places = _places(deviation)
    bell = np.exp(-((places / deviation) ** 2) / 2)
    second = ((places / deviation) ** 2 - 1) * bell
    return _Filters(
        tuple(sensitivity), bell / bell.sum(), _balanced(-places * bell), _balanced(second)
    )


def _places(deviation: float) -> Kernel:
    """Return the places of a filter's weights, in pixels from its middle."""
    reach = int(np.ceil(REACH * deviation))
    return np.arange(-reach, reach + 1, dtype=np.float64)


def _balanced(row: Kernel) -> Kernel:
    """Scale a row's positive weights to a sum of 1, its negative ones to -1."""
    return np.asarray(np.where(row > 0, row / row[row > 0].sum(), row / -row[row < 0].sum()))
