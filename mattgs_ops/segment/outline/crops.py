"""Training pairs for the outline: crops of photos along outlines, and coarse maps of their masks.

A batch follows from the seed and the step alone, so that a resumed training sees what an
uninterrupted one would have seen.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.segment.network.augment import spoil
from mattgs_ops.segment.outline.coarse import outline_of, spoil_mask

Image = NDArray[np.uint8]
SCALES = (0.55, 1.5)  # of the images: sharp outlines, and those of soft photos
ROTATION = 20.0  # degrees, to either side
SPOILT = 0.75  # share of crops whose colours are spoilt like a camera's
NEAR = 6  # pixels around the true outline, and the coarse one, where errors count
ELSEWHERE = 0.1  # weight of the other pixels

Drawn = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True)
class Pair:
    """A photo [H, W, 3] RGB, its mask [H, W], both uint8, and the pixels (x, y) of its outline."""

    image: Image
    mask: Image
    outline: NDArray[np.int32]


def load_pairs(folder: Path) -> list[Pair]:
    """Read ``images/NAME.*`` and ``masks/NAME.png`` of a folder, but for masks without outline.

    Raises :class:`InputError` for a folder without any, and for a file that cannot be read.
    """
    paths = sorted(p for p in (folder / "images").glob("*") if p.suffix in (".png", ".jpg"))
    pairs = []
    for path in paths:
        image = cv2.imread(str(path))
        mask_file = folder / "masks" / path.with_suffix(".png").name
        mask = cv2.imread(str(mask_file), cv2.IMREAD_GRAYSCALE)
        if image is None or mask is None or image.shape[:2] != mask.shape:
            raise InputError(f"{path}: expected an image, and in masks/ a mask of its size")
        outline = outline_of((mask > 127).astype(np.uint8))
        if len(outline):
            rgb = np.ascontiguousarray(image[..., ::-1])
            pairs.append(Pair(rgb, np.asarray(mask, dtype=np.uint8), outline))
    if not pairs:
        raise InputError(
            f"{folder / 'images'}: expected images with an object (.png, .jpg), found none"
        )
    return pairs


def batch(folders: list[list[Pair]], seed: int, step: int, size: int, count: int) -> Drawn:
    """Return photos and coarse maps [B, 4, S, S], truths and weights [B, 1, S, S], all 0 to 1.

    Each folder's pairs have the same share of them.
    """
    rng = np.random.default_rng((seed, step))
    inputs = np.empty((count, 4, size, size), np.float32)
    truths, weights = np.empty((2, count, 1, size, size), np.float32)
    for slot in range(count):
        pairs = folders[int(rng.integers(len(folders)))]
        pair = pairs[int(rng.integers(len(pairs)))]
        image, mask = cut(rng, pair, size)
        if rng.random() < SPOILT:
            image = spoil(rng, image)
        inputs[slot, :3] = image.transpose(2, 0, 1).astype(np.float32) / 255
        inputs[slot, 3] = spoil_mask(rng, mask)
        truths[slot, 0] = mask.astype(np.float32) / 255
        weights[slot, 0] = _weights(truths[slot, 0], inputs[slot, 3])
    return inputs, truths, weights


def _weights(truth: NDArray[np.float32], coarse: NDArray[np.float32]) -> NDArray[np.float32]:
    near = np.ones((2 * NEAR + 1, 2 * NEAR + 1), np.uint8)
    outlines = [cv2.dilate(map_, near) - cv2.erode(map_, near) for map_ in (truth, coarse)]
    return np.where(np.maximum(*outlines) > 0.5, 1, ELSEWHERE).astype(np.float32)


def cut(rng: np.random.Generator, pair: Pair, size: int) -> tuple[Image, Image]:
    """Cut a turned, scaled and mirrored square [S, S] around a pixel of the outline."""
    x, y = pair.outline[int(rng.integers(len(pair.outline)))] + rng.normal(0, size / 8, 2)
    scale = float(np.exp(rng.uniform(*np.log(SCALES))))
    angle = np.radians(rng.uniform(-ROTATION, ROTATION))
    c, s = np.cos(angle) / scale, np.sin(angle) / scale
    flip = -1.0 if rng.random() < 0.5 else 1.0
    turn = np.array([[c * flip, -s], [s * flip, c]])
    shift = np.array([x, y]) - turn @ np.full(2, (size - 1) / 2)
    matrix = np.concatenate([turn, shift[:, None]], axis=1)
    image, mask = pair.image, pair.mask
    if scale < 1:  # the warp takes single pixels: blur what would alias
        image, mask = (cv2.GaussianBlur(a, (0, 0), 0.4 / scale) for a in (image, mask))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    image, mask = (
        cv2.warpAffine(a, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REFLECT_101)
        for a in (image, mask)
    )
    return np.asarray(image, dtype=np.uint8), np.asarray(mask, dtype=np.uint8)
