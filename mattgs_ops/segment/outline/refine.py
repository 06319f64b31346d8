"""Move a mask's outline to the object's by the bundled network, at the photo's resolution.

The network is asked twice: about the map that a mask was cut from, and about the mask. Their mean
counts where it is sure; elsewhere the mask stays as it is. Only what is near its outline changes.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import HALF, Mask, SoftMap, disc
from mattgs_ops.segment.onnx_files.onnx_file import BUNDLED, open_model
from mattgs_ops.segment.outline.network import MULTIPLE

# made by ``mattgs segment outline`` with the recipe beside it, then ``mattgs segment quantize``
BUNDLED_OUTLINE = BUNDLED / "outline-int8.onnx"
LONGEST_SIDE = 1024  # pixels: larger photos are shrunk, so that errors span as much as learnt
REACH = 16  # pixels around the outline, there; what is farther stays
CONTEXT = 32  # pixels around the reach that the network sees, too
SURE = 0.75  # three to one; below, the mask stays that votes and the photo's edges made


class OutlineRefiner:
    """The network's file, opened. One refiner may be asked from several threads.

    Raises :class:`InputError` for a file that is none.
    """

    def __init__(self, path: Path = BUNDLED_OUTLINE, *, threads: int = 1) -> None:
        self._session = open_model(path, threads, "an outline model")

    def refine(self, photo: NDArray[np.uint8], soft: SoftMap, mask: Mask) -> Mask:
        """Return the mask [H, W] with its outline on the object's.

        ``photo`` [H, W, 3] is RGB, ``soft`` [H, W] in [0, 1] the map that ``mask`` was cut from. A
        mask without an outline comes back as it is.
        """
        shares, near = self._shares(photo, soft, mask > 127, LONGEST_SIDE)
        refined: Mask = mask.copy()
        refined[near & (shares >= SURE)] = 255
        refined[near & (shares <= 1 - SURE)] = 0
        return refined

    def mend(self, photo: NDArray[np.uint8], soft: SoftMap) -> SoftMap:
        """Return the map [H, W] with what a look from afar corrects, at half of the size.

        There errors of twice the reach are mended, and less of the photo's detail is seen; photos
        that are no larger than that are looked at as they are. A map changes where the network is
        sure of the opposite of what it says.
        """
        says = soft >= HALF
        shares, near = self._shares(photo, soft, says, LONGEST_SIDE // 2)
        sure = near & np.where(says, shares <= 1 - SURE, shares >= SURE)
        mended: SoftMap = np.where(sure, shares, soft).astype(np.float32)
        return mended

    def _shares(
        self, photo: NDArray[np.uint8], soft: SoftMap, binary: NDArray[np.bool_], side: int
    ) -> tuple[SoftMap, NDArray[np.bool_]]:
        """Return the object's shares, and where they count: near the outline of ``binary`` [H, W].

        The network sees at most ``side`` pixels of the longest side.
        """
        height, width = binary.shape
        factor = min(1.0, side / max(height, width))
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        seen, map_, cut = (_shrunk(a, size) for a in (photo, soft, binary.astype(np.float32)))
        near = _around_outline(cut)
        shares = np.where(cut >= HALF, np.float32(1), np.float32(0))
        if near.any():
            window = _span(near, 1), _span(near, 0)
            answered = self._ask(seen[window], map_[window], cut[window])
            shares[window] = np.where(near[window], answered, shares[window])
        if factor < 1:
            full = width, height
            shares = cv2.resize(shares, full, interpolation=cv2.INTER_LINEAR)
            near = cv2.resize(near.astype(np.uint8), full, interpolation=cv2.INTER_NEAREST) > 0
        return np.asarray(shares, dtype=np.float32), np.asarray(near)

    def _ask(self, photo: NDArray[np.uint8], *maps: SoftMap) -> SoftMap:
        """Return the mean of what the network says of each map, [H, W]."""
        height, width = maps[0].shape
        unit = photo.astype(np.float32).transpose(2, 0, 1) / 255
        stacked = np.stack([np.concatenate([unit, map_[None]]) for map_ in maps])
        beyond = ((0, 0), (0, 0), (0, -height % MULTIPLE), (0, -width % MULTIPLE))
        asked = np.pad(stacked, beyond, mode="edge")
        (answers,) = self._session.run(None, {self._session.get_inputs()[0].name: asked})
        return np.asarray(answers[:, 0, :height, :width].mean(axis=0), dtype=np.float32)


def _shrunk(pixels: Any, size: tuple[int, int]) -> Any:
    """Photo or map at ``size`` (width, height)."""
    same = pixels.shape[1::-1] == size
    return pixels if same else cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)


def _around_outline(map_: SoftMap) -> NDArray[np.bool_]:
    """Return the pixels [H, W] that are within reach of the outline."""
    binary = (map_ >= HALF).astype(np.uint8)
    reach = disc(REACH)
    return np.asarray(cv2.dilate(binary, reach) > cv2.erode(binary, reach))


def _span(free: NDArray[np.bool_], axis: int) -> slice:
    """Return the rows (``axis`` 1) or columns (0) with free pixels, and the context around them."""
    where = np.flatnonzero(free.any(axis=axis))
    return slice(max(0, int(where[0]) - CONTEXT), int(where[-1]) + 1 + CONTEXT)
