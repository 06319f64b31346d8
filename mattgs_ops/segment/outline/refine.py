"""Move a mask's outline to the object's by the bundled network, at the photo's resolution."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.segment.onnx_file import open_model

BUNDLED_OUTLINE = Path(__file__).resolve().parents[2] / "bundled" / "segmenter" / "outline.onnx"
LONGEST_SIDE = 1024  # pixels: larger photos are shrunk, so that errors span as much as learnt
REACH = 16  # pixels around the outline, there; what is farther stays
CONTEXT = 32  # pixels around the reach that the network sees, too
MULTIPLE = 16  # of pixels that the network asks for


class OutlineRefiner:
    """The network's file, opened. One refiner may be asked from several threads."""

    def __init__(self, path: Path = BUNDLED_OUTLINE, *, threads: int = 1) -> None:
        self._session = open_model(path, threads, "an outline model")

    def refine(self, photo: NDArray[np.uint8], soft: SoftMap) -> SoftMap:
        """Photo [H, W, 3] RGB and map [H, W] in [0, 1] to a map whose outline is the object's.

        A map without an outline comes back as it is.
        """
        height, width = soft.shape
        factor = min(1.0, LONGEST_SIDE / max(height, width))
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        seen = photo if factor == 1 else cv2.resize(photo, size, interpolation=cv2.INTER_AREA)
        map_ = soft if factor == 1 else cv2.resize(soft, size, interpolation=cv2.INTER_AREA)
        free = _around_outline(map_)
        if not free.any():
            return soft
        rows, columns = (_span(free, axis) for axis in (1, 0))
        window = (rows, columns)
        answered = self._ask(seen[window], map_[window])
        refined = map_.copy()
        refined[window] = np.where(free[window], answered, map_[window])
        if factor == 1:
            return refined
        full = cv2.resize(refined, (width, height), interpolation=cv2.INTER_CUBIC)
        near = cv2.resize(free.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
        return np.where(near > 0, np.clip(full, 0, 1), soft).astype(np.float32)

    def _ask(self, photo: NDArray[np.uint8], map_: SoftMap) -> SoftMap:
        height, width = map_.shape
        down, right = -height % MULTIPLE, -width % MULTIPLE
        unit = photo.astype(np.float32).transpose(2, 0, 1) / 255
        stacked = np.concatenate([unit, map_[None]])
        padded = np.pad(stacked, ((0, 0), (0, down), (0, right)), mode="edge")
        (answer,) = self._session.run(None, {"photo_and_map": padded[None]})
        return np.asarray(answer[0, 0, :height, :width], dtype=np.float32)


def _around_outline(map_: SoftMap) -> NDArray[np.bool_]:
    """Return the pixels [H, W] that are within reach of the outline."""
    binary = (map_ >= 0.5).astype(np.uint8)
    side = 2 * REACH + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.dilate(binary, disc) > cv2.erode(binary, disc))


def _span(free: NDArray[np.bool_], axis: int) -> slice:
    where = np.flatnonzero(free.any(axis=axis))
    return slice(max(0, int(where[0]) - CONTEXT), int(where[-1]) + 1 + CONTEXT)
