"""Attention as MATT-GS has it: a Sobel map that weights the loss and selects points.

Eqs. 9–14: grey is the mean of R, G and B; two 3 × 3 Sobel kernels; the magnitude of the two
responses; min–max per image to A in [0, 1]. The paper does not say what happens at the border
(the image is mirrored about its outermost pixels here) nor on a constant image (A is 0 there).

Four maps, named in :class:`~mattgs_ops.method.MethodConfig`:

* ``paper``: the above on the training image as it is. On white composites the silhouette of the
  cut-out is then usually the strongest edge.
* ``interior``: on the photo before compositing, zero on a band along the mask's edge and, where
  the background was removed, zero outside the object; min–max over the pixels that are left.
* ``object``: ``interior``, zero outside the object whether or not the background was removed.
* ``local``: on the object, each magnitude relative to the magnitudes around it, so that one glint
  does not take all attention from print and screws elsewhere (divisive normalisation, Heeger 1992).

All maps are float32 [H, W].
"""

import math
from collections.abc import Sequence
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, in_frame
from mattgs_ops.method import MethodConfig

Floats = NDArray[np.float32]

EDGE_BAND = 2  # pixels to either side of the mask's edge: one of Sobel's reach, one of edge blur
MASK_THRESHOLD = 0.5  # a pixel is object when at least this share of it is
# Of ``local``, set by looking at maps of the capture `desk_extra`: the neighbourhood's standard
# deviation as a share of the longest side; at how many times the neighbourhood's mean attention is
# a half; and the share of the whole object's mean below which a neighbourhood counts as flat.
NEIGHBOURHOOD, HALF_AT, FLAT = 0.05, 2.0, 0.25
TINY = np.float32(1e-12)  # keeps 0 / 0 at 0
NEAR_DEPTH = 1e-6  # points at or behind the camera's centre have no projection


def sobel_magnitude(image: Floats) -> Floats:
    """Return eqs. 9–13: the gradient's magnitude of the mean grey of ``image`` [H, W, 3]."""
    grey = image.mean(axis=2, dtype=np.float32)
    border = cv2.BORDER_REFLECT_101
    gx = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3, borderType=border)
    gy = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=3, borderType=border)
    magnitude: Floats = np.sqrt(gx * gx + gy * gy)
    return magnitude


def paper_attention(image: Floats) -> Floats:
    """Return A of eqs. 9–14 for ``image`` [H, W, 3] in [0, 1]; all 0 for a constant image."""
    return _min_max(sobel_magnitude(image), None)


def interior_attention(photo: Floats, mask: Floats, *, removed: bool) -> Floats:
    """Return A of the photo [H, W, 3] without the mask's own outline.

    ``mask`` [H, W] in [0, 1]; ``removed`` says that the background was composited away, so that
    nothing outside the object counts.
    """
    kept = inner(mask)
    if not removed:
        kept |= ~_grown(mask >= MASK_THRESHOLD, EDGE_BAND)
    return _min_max(sobel_magnitude(photo), kept)


def local_attention(photo: Floats, mask: Floats) -> Floats:
    """Return A of the photo [H, W, 3] relative to what is near, zero off the object and its edge.

    A = S / (S + HALF_AT (near(S) + FLAT mean(S))) in [0, 1), where S is Sobel's magnitude, ``near``
    its mean over the object's pixels weighted by a Gaussian about the pixel, and ``mean`` that over
    the whole object. ``mask`` [H, W] in [0, 1].
    """
    kept = inner(mask).astype(np.float32)
    magnitude: Floats = sobel_magnitude(photo) * kept
    sigma = NEIGHBOURHOOD * max(mask.shape)
    share = np.maximum(_blurred(kept, sigma), TINY)
    mean = magnitude.sum(dtype=np.float64) / max(kept.sum(dtype=np.float64), 1.0)
    around = _blurred(magnitude, sigma) / share + np.float32(FLAT * mean)
    whole: Floats = np.maximum(magnitude + np.float32(HALF_AT) * around, TINY, dtype=np.float32)
    found: Floats = magnitude / whole
    return found


def inner(mask: Floats) -> NDArray[np.bool_]:
    """Return the object's pixels [H, W] farther than ``EDGE_BAND`` from what is not the object."""
    return ~_grown(mask < MASK_THRESHOLD, EDGE_BAND)


def attention_map(
    image: Floats,
    photo: Floats,
    mask: Floats,
    *,
    kind: Literal["paper", "interior", "object", "local"],
    removed: bool,
) -> Floats:
    """Return the map that a method asks for; arguments as in the functions above."""
    if kind == "paper":
        return paper_attention(image)
    if kind == "local":
        return local_attention(photo, mask)
    return interior_attention(photo, mask, removed=removed or kind == "object")


def loss_weights(
    attention: Floats, mask: Floats, method: MethodConfig, *, removed: bool
) -> Floats | None:
    """Return the weight of each pixel's L1 [H, W], or None for plain L1.

    ``paper`` (eq. 15): A itself. ``residual`` (eq. 6): 1 + weight · A + mask_weight · M with the
    mask M [H, W] in [0, 1], divided by its mean over the image, so that the loss keeps its scale
    against D-SSIM. ``within``: (1 + mask_weight · M) · g, where g is 1 + weight · A divided by its
    mean over the object without its edge, and 1 at the edge and outside. So attention takes its
    weight from the object's flat parts, not from its outline or surroundings.

    Where the background was ``removed``, nothing but the mask says that a pixel is empty, and masks
    err at their edges, differently in each view: pixels outside M but within ``edge_tolerance``
    (times the longest side, rounded) of it then weigh nothing, so that no view erases what others
    show.
    """
    if method.weighting == "none":
        return None
    if method.weighting == "paper":
        return attention
    by_attention: Floats = 1 + np.float32(method.weight) * attention
    if method.weighting == "within":
        kept = inner(mask)
        mean = by_attention.mean(where=kept, dtype=np.float64) if kept.any() else 1.0
        by_attention = np.where(kept, by_attention / np.float32(mean), np.float32(1))
        raised: Floats = (1 + np.float32(method.mask_weight) * mask) * by_attention
    else:
        raised = by_attention + np.float32(method.mask_weight) * mask
    pixels = round(method.edge_tolerance * max(mask.shape))
    if removed and pixels:
        inside = mask >= MASK_THRESHOLD
        raised[_grown(inside, pixels) & ~inside] = 0
    weights: Floats = raised / np.float32(raised.mean(dtype=np.float64))
    return weights


def _blurred(values: Floats, sigma: float) -> Floats:
    """Return the weighted mean about each pixel; zeros lie beyond the frame.

    Two means over squares have the weights of a pyramid, nearly a Gaussian's, at a fixed cost: a
    square of side s has the variance (s² - 1) / 12 along each axis.
    """
    side = 2 * round(math.sqrt(6 * sigma**2 + 1) / 2 - 0.5) + 1  # odd
    for _ in range(2):
        values = cv2.blur(values, (side, side), borderType=cv2.BORDER_CONSTANT)
    return values


def _grown(region: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Return what is at most ``pixels`` from a region in either direction."""
    reach = np.ones((2 * pixels + 1,) * 2, np.uint8)
    # outside the frame counts as more of the same: the frame's border is no edge of the mask
    near = cv2.dilate(region.astype(np.uint8), reach, borderType=cv2.BORDER_REPLICATE)
    found: NDArray[np.bool_] = near.astype(np.bool_)
    return found


def point_scores(
    points: NDArray[np.float64], cameras: Sequence[Camera], maps: Sequence[Floats]
) -> tuple[Floats, NDArray[np.int32]]:
    """Score points [P, 3] by the attention where they project, the paper's ``pixel`` reading.

    A view sees a point when it lies in front of the camera and projects into the frame; nothing
    is said in the paper about points hidden behind others, so they count as seen. Returns the
    mean of A (bilinear between pixel centres, the outermost values held to the border) over the
    views that see the point, 0 where none does, as [P] float32, and how many do, [P] int32.
    """
    total = np.zeros(len(points), dtype=np.float64)
    seen = np.zeros(len(points), dtype=np.int32)
    for camera, attention in zip(cameras, maps, strict=True):
        pixels, depth = camera.project(points)
        height, width = attention.shape
        visible = in_frame(pixels, depth, (width, height), beyond=NEAR_DEPTH)
        total[visible] += _bilinear(attention, pixels[visible])
        seen += visible
    return (total / np.maximum(seen, 1)).astype(np.float32), seen


def _bilinear(values: Floats, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    height, width = values.shape
    x = np.clip(pixels[:, 0] - 0.5, 0, width - 1)
    y = np.clip(pixels[:, 1] - 0.5, 0, height - 1)
    left, top = x.astype(np.int64), y.astype(np.int64)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    fx, fy = x - left, y - top
    upper = values[top, left] * (1 - fx) + values[top, right] * fx
    lower = values[bottom, left] * (1 - fx) + values[bottom, right] * fx
    mixed: NDArray[np.float64] = upper * (1 - fy) + lower * fy
    return mixed


def _min_max(values: Floats, kept: NDArray[np.bool_] | None) -> Floats:
    """Stretch ``values`` to [0, 1] over the ``kept`` pixels; the others become 0."""
    chosen = values if kept is None else values[kept]
    if chosen.size == 0:
        return np.zeros_like(values)
    low, high = chosen.min(), chosen.max()
    if not high > low:
        return np.zeros_like(values)
    stretched = (values - low) / (high - low)
    return stretched if kept is None else np.where(kept, stretched, np.float32(0))
