"""The photo's own edges: outlines are compared with them, and moved to them.

No object ends in the middle of even cloth: how much of an outline lies on edges of the photo says
how likely it is right (``share_on_edges``).

``to_photo_edges`` moves outlines at the photo's resolution. Masks by votes are rendered from
splats, smaller than the photo. The guided filter (He, Sun & Tang 2010) fits, in a window around
each pixel, the mask as a linear function of the photo's colours: the outline moves to an edge of
the photo nearby, and stays where there is none. Only a band around the outline changes. What is
thinner than the band on either side, wires and aerials and the gaps between them, has no inside to
fit colours to and stays as it was.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import Mask, clean, disc

EDGE = 0.02  # of the range, per pixel: five grey levels; sensors and JPEG stay below
EDGE_REACH = 2  # pixels, at the size of the maps, between an outline and the photo's edge
REACH = 0.01  # of the longest side: window and band; two to three pixels of the votes' maps
FLAT = 1e-4  # variance of colours in [0, 1]: (2.5 grey levels)², noise; flatter is no edge

Bits = NDArray[np.bool_]


def edges_near(photo: NDArray[np.uint8]) -> Bits:
    """Return where a photo [H, W, 3] has an edge within reach [H, W]."""
    unit = photo.astype(np.float32) / 255
    # Sobel's kernel sums to 8 for a slope of 1 a pixel
    slopes = np.hypot(cv2.Sobel(unit, cv2.CV_32F, 1, 0), cv2.Sobel(unit, cv2.CV_32F, 0, 1)) / 8
    side = 2 * EDGE_REACH + 1
    strong = (slopes.max(axis=2) > EDGE).astype(np.uint8)
    near: Bits = cv2.dilate(strong, np.ones((side, side), np.uint8)) > 0
    return near


def share_on_edges(mask: Bits, edges: Bits) -> float:
    """Return the share of a mask's outline that lies on edges; 0 where there is no outline.

    The mask is cleaned first, as masks are that are delivered. Where it leaves the photo there is
    no outline.
    """
    binary = clean(np.where(mask, 255, 0).astype(np.uint8))
    inside = cv2.erode(binary, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)
    outline = (binary > 0) & (inside == 0)
    return float(edges[outline].mean()) if outline.any() else 0.0


def to_photo_edges(mask: Mask, photo: NDArray[np.uint8]) -> Mask:
    """Return the mask [H, W] with its outline on edges of the photo [H, W, 3] uint8."""
    reach = max(1, round(REACH * max(mask.shape)))
    near, wider = disc(reach), disc(reach + 1)
    binary = (mask > 127).astype(np.uint8)
    inside, around = cv2.erode(binary, near, borderValue=1), cv2.dilate(binary, near)
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
