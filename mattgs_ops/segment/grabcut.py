"""GrabCut (Rother, Kolmogorov & Blake 2004): alone, or seeded by a saliency map.

Alone it starts from a frame around the middle of the photo. Seeded, it only decides the pixels
about which the network is unsure, by the colours of those about which it is sure.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import Mask, SoftMap, disc

LONGEST_SIDE = 640  # GrabCut's cost grows faster than the number of pixels
ITERATIONS = 4
MARGIN = 0.06  # of each side: the frame outside which everything is background
SURE_OBJECT, SURE_BACKGROUND = 0.9, 0.1  # of the saliency map
BAND = 0.015  # of the longest side: how far around a sure region the network is not trusted
SEED = 0  # GrabCut clusters colours by a random start


def grabcut(photo: NDArray[np.uint8]) -> Mask:
    """Photo [H, W, 3] RGB to a mask [H, W], from a frame around its middle."""
    small = _shrunk(photo)
    height, width = small.shape[:2]
    labels = np.full((height, width), cv2.GC_BGD, np.uint8)
    y, x = int(MARGIN * height), int(MARGIN * width)
    labels[y : height - y, x : width - x] = cv2.GC_PR_FGD
    return _cut(small, labels, photo.shape[:2])


def grabcut_seeded(photo: NDArray[np.uint8], soft: SoftMap) -> Mask:
    """Photo [H, W, 3] RGB and saliency [H, W] to a mask [H, W].

    Where the map leaves no sure object or no sure background, the map's own threshold is kept.
    """
    small, map_ = _shrunk(photo), _shrunk(soft)
    disc = doubt_disc(map_.shape)
    sure_object = cv2.erode((map_ >= SURE_OBJECT).astype(np.uint8), disc)
    sure_background = cv2.erode((map_ <= SURE_BACKGROUND).astype(np.uint8), disc)
    if not sure_object.any() or not sure_background.any():
        return np.where(soft >= 0.5, 255, 0).astype(np.uint8)
    labels = np.where(map_ >= 0.5, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[sure_object > 0] = cv2.GC_FGD
    labels[sure_background > 0] = cv2.GC_BGD
    return _cut(small, labels, photo.shape[:2])


def doubt_disc(shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the disc by which regions of a map [H, W] are eroded that it is sure about."""
    return disc(max(1, round(BAND * max(shape))))


def _shrunk(pixels: Any) -> Any:
    """Photo or map, longest side at most ``LONGEST_SIDE``."""
    factor = LONGEST_SIDE / max(pixels.shape[:2])
    if factor >= 1:
        return pixels
    size = (round(pixels.shape[1] * factor), round(pixels.shape[0] * factor))
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)


def _cut(photo: NDArray[np.uint8], labels: NDArray[np.uint8], shape: tuple[int, ...]) -> Mask:
    cv2.setRNGSeed(SEED)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    bgr = np.ascontiguousarray(photo[..., ::-1])
    cv2.grabCut(bgr, labels, None, *models, ITERATIONS, cv2.GC_INIT_WITH_MASK)
    found = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    if found.shape != shape:
        found = cv2.resize(found, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    mask: Mask = np.where(found >= 0.5, 255, 0).astype(np.uint8)
    return mask
