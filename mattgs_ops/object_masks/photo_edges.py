"""Outlines moved to the photo's own edges, at the photo's resolution.

Masks by votes are rendered from splats, smaller than the photo. The guided filter (He, Sun & Tang
2010) fits, in a window around each pixel, the mask as a linear function of the photo's colours: the
outline moves to an edge of the photo nearby, and stays where there is none. Only a band around
the outline changes. What is thinner than the band on either side, wires and aerials and the gaps
between them, has no inside to fit colours to and stays as it was.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import Mask

REACH = 0.01  # of the longest side: window and band; two to three pixels of the votes' maps
FLAT = 1e-4  # variance of colours in [0, 1]: (2.5 grey levels)², noise; flatter is no edge


def to_photo_edges(mask: Mask, photo: NDArray[np.uint8]) -> Mask:
    """Return the mask [H, W] with its outline on edges of the photo [H, W, 3] uint8."""
    reach = max(1, round(REACH * max(mask.shape)))
    disc, wider = (
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1))
        for r in (reach, reach + 1)
    )
    binary = (mask > 127).astype(np.uint8)
    inside, around = cv2.erode(binary, disc, borderValue=1), cv2.dilate(binary, disc)
    if not inside.any():
        return mask
    thin = (binary > 0) & (cv2.dilate(inside, wider) == 0)
    narrow = (binary == 0) & (cv2.erode(around, wider, borderValue=1) > 0)
    guided = cv2.ximgproc.guidedFilter(
        photo, binary.astype(np.float32) * 255, reach, FLAT * 255 * 255
    )
    free = (inside == 0) & (around > 0) & ~thin & ~narrow
    moved: Mask = np.where(free, (guided >= 127.5) * 255, mask).astype(np.uint8)
    return moved
