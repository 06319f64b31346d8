"""Masks: from a soft map to a clean binary one, composites on white, names on disk, quality.

A mask is [H, W] uint8, 255 = object, 0 = background; a soft map is [H, W] float32 in 0..1. On disk
a mask is called ``NAME.png`` after the photo's whole name (``IMG_1.jpg.png``), as COLMAP expects;
COLMAP and nerfstudio both take 0 as "ignore", so the polarity is the same everywhere here. A user's
own masks are found and checked in ``mask_files``.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError

Mask = NDArray[np.uint8]
SoftMap = NDArray[np.float32]
HALF = 0.5  # from here on a map says object

# cleaning: what is kept of a thresholded map, as shares of the largest part or of the object
SPECK_SHARE = 0.02  # parts smaller than this share of the largest part are dropped
HOLE_SHARE = 0.0005  # holes smaller than this share of the object's area are filled
BOUNDARY_TOLERANCE = 0.0075  # of the image diagonal, the usual choice for boundary measures
F_BETA_SQUARED = 0.3  # weighs precision over recall, as in the saliency literature


def threshold(soft: SoftMap, level: float = HALF) -> Mask:
    """Soft map [H, W] to a binary mask: 255 where it reaches ``level``."""
    mask: Mask = np.where(soft >= level, 255, 0).astype(np.uint8)
    return mask


def clean(mask: Mask) -> Mask:
    """Drop specks and fill pinholes, leave real openings (wheels, between legs) alone.

    Rule: 8-connected parts smaller than ``SPECK_SHARE`` of the largest part are dropped;
    4-connected holes smaller than ``HOLE_SHARE`` of what is left are filled.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count < 2:
        return np.zeros_like(mask)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    kept: Mask = np.where(areas >= SPECK_SHARE * areas.max(), 255, 0).astype(np.uint8)[labels]
    limit = HOLE_SHARE * int((kept > 0).sum())
    holes, hole_labels, hole_stats, _ = cv2.connectedComponentsWithStats(255 - kept, connectivity=4)
    height, width = mask.shape
    left, top = hole_stats[:, cv2.CC_STAT_LEFT], hole_stats[:, cv2.CC_STAT_TOP]
    right = left + hole_stats[:, cv2.CC_STAT_WIDTH]
    bottom = top + hole_stats[:, cv2.CC_STAT_HEIGHT]
    inner = (left > 0) & (top > 0) & (right < width) & (bottom < height)
    small = inner & (hole_stats[:, cv2.CC_STAT_AREA] < limit)
    fill = np.arange(holes)[small]
    kept[np.isin(hole_labels, fill)] = 255
    return kept


def parts_apart(mask: NDArray[np.bool_], seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the 8-connected parts of ``mask`` [H, W] of which ``seen`` holds less than half.

    The largest part is none of them. Where nothing is seen, nothing is apart from it.
    """
    if not seen.any():
        return np.zeros_like(mask)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA]
    apart = 2 * np.bincount(labels[seen], minlength=len(areas)) < areas
    apart[0] = False  # what is no part
    if len(areas) > 1:
        apart[1 + int(areas[1:].argmax())] = False
    found: NDArray[np.bool_] = apart[labels]
    return found


def mask_name(photo: str) -> str:
    """File name of a photo's mask: ``IMG_1.jpg`` to ``IMG_1.jpg.png``."""
    return f"{photo}.png"


@dataclass(frozen=True)
class MaskQuality:
    """How well a mask agrees with the truth; all in 0..1, ``mae`` the lower the better."""

    iou: float
    f_measure: float
    mae: float
    boundary_f: float

    def as_dict(self) -> dict[str, float]:
        """Return the four values by name."""
        return asdict(self)


def quality(mask: Mask, truth: Mask, soft: SoftMap | None = None) -> MaskQuality:
    """Compare a binary mask with the true one; MAE is taken on ``soft`` where it is given."""
    found, real = mask > 127, truth > 127
    overlap, union = int((found & real).sum()), int((found | real).sum())
    precision = overlap / max(1, int(found.sum()))
    recall = overlap / max(1, int(real.sum()))
    weighted = F_BETA_SQUARED * precision + recall
    f_measure = (1 + F_BETA_SQUARED) * precision * recall / weighted if weighted else 0.0
    shown = found.astype(np.float32) if soft is None else soft
    mae = float(np.abs(shown - real).mean())
    iou = overlap / union if union else 1.0
    return MaskQuality(iou, f_measure, mae, boundary_f(mask, truth))


def disc(radius: int) -> NDArray[np.uint8]:
    """Return the disc [2 R + 1, 2 R + 1] by which masks grow and shrink."""
    side = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), dtype=np.uint8)


def boundary_f(mask: Mask, truth: Mask, radius: int | None = None) -> float:
    """F1 of the outlines, matched within ``radius`` pixels.

    Without one it is ``BOUNDARY_TOLERANCE`` of the diagonal.
    """
    height, width = mask.shape
    radius = radius or max(1, round(BOUNDARY_TOLERANCE * float(np.hypot(height, width))))
    lines = [_outline(m) for m in (mask, truth)]
    near = [cv2.dilate(line, disc(radius)) > 0 for line in lines]
    counts = [int((line > 0).sum()) for line in lines]
    if not all(counts):
        return float(counts[0] == counts[1])
    precision = int(((lines[0] > 0) & near[1]).sum()) / counts[0]
    recall = int(((lines[1] > 0) & near[0]).sum()) / counts[1]
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _outline(mask: Mask) -> Mask:
    binary = np.where(mask > 127, 255, 0).astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    eroded = cv2.erode(binary, cross, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    outline: Mask = cv2.subtract(binary, eroded)
    return outline


def read_map(path: Path) -> Mask:
    """Read a mask or an 8-bit map [H, W]; raises :class:`InputError` naming the file."""
    pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if pixels is None:
        raise InputError(f"{path}: expected a readable mask, found something else")
    return np.asarray(pixels, dtype=np.uint8)


def map_folders(soft: Path) -> list[Path]:
    """Return the folders of maps: ``soft`` and, of several networks, ``soft/1``, ``soft/2``, ….

    ``soft`` has the mean of what the networks say, the others what each says by itself.
    """
    numbered = [folder for folder in soft.iterdir() if folder.name.isdecimal() and folder.is_dir()]
    return [soft, *sorted(numbered, key=lambda folder: int(folder.name))]
