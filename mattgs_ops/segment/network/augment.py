"""What is done to a training image before the network sees it: geometry, colour, blur, noise.

The paper's recipe is RescaleT, a random crop and flips; rotation, scaling, colour and blur are
added here. Images are [H, W, 3] uint8 RGB, masks [H, W] uint8 (255 = object) of the same size.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.network.train_config import AugmentConfig
from mattgs_ops.segment.training_images.cards import lay_cards

Image = NDArray[np.uint8]

CLOSE = (0.3, 0.7)  # of the side that a close-up shows
LEAST, MOST = 0.15, 0.92  # of a close-up that is object


def augment(
    rng: np.random.Generator, image: Image, mask: Image, size: int, config: AugmentConfig
) -> tuple[Image, Image]:
    """Return image [S, S, 3] and mask [S, S]: turned, scaled, cropped, flipped and spoiled."""
    if config.cards and rng.random() < config.cards:
        image = lay_cards(rng, image, mask)
    height, width = mask.shape
    near = _close_up(rng, mask) if config.close_ups and rng.random() < config.close_ups else None
    crop = near[0] if near else rng.uniform(config.crop, 1.0)
    angle = np.radians(rng.uniform(-config.rotation, config.rotation))
    c, s = np.cos(angle) * crop, np.sin(angle) * crop
    flip_x = -1.0 if rng.random() < config.flip_horizontal else 1.0
    flip_y = -1.0 if rng.random() < config.flip_vertical else 1.0
    # maps pixels of the result to pixels of the source, both centred and in units of their size
    turn = np.array([[c * flip_x, -s * flip_y], [s * flip_x, c * flip_y]])
    turn = np.diag([width / size, height / size]) @ turn
    middle = np.array([width, height]) / 2 * (1 + rng.uniform(-1, 1, 2) * (1 - crop))
    middle = near[1] if near else middle
    shift = middle - turn @ np.array([size, size]) / 2
    matrix = np.concatenate([turn, shift[:, None]], axis=1)
    # warps have no area filter: photos much larger than ``size`` alias, as they did when the
    # bundled networks were trained, whose recipes this keeps
    flags, border = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, cv2.BORDER_REFLECT_101
    square = (size, size)
    image = cv2.warpAffine(image, matrix, square, flags=flags, borderMode=border)
    mask = cv2.warpAffine(mask, matrix, square, flags=flags, borderMode=border)
    if config.harsh and rng.random() < config.harsh:
        image = harsh_light(rng, image)
    return spoil(rng, image), mask


def _close_up(rng: np.random.Generator, mask: Image) -> tuple[float, NDArray[np.float64]] | None:
    """Draw a window on the object of a mask [H, W]: its share of the side and its middle (x, y).

    None where the window would hold nearly nothing but object, or nearly none of it.
    """
    inside = np.argwhere(mask > 127)
    if len(inside) == 0:
        return None
    crop = float(rng.uniform(*CLOSE))
    half = crop * np.array(mask.shape) / 2
    middle = np.clip(inside[int(rng.integers(len(inside)))], half, np.array(mask.shape) - half)
    (top, left), (bottom, right) = (middle - half).astype(int), (middle + half).astype(int)
    if not LEAST <= float((mask[top:bottom, left:right] > 127).mean()) <= MOST:
        return None
    return crop, middle[::-1].astype(np.float64)


def harsh_light(rng: np.random.Generator, image: Image) -> Image:
    """Relight an image [S, S, 3] as a lamp, a window or the sun would.

    Tones go deep or flat, colours pale or strong, a lamp tints all, one side lies in the dark, and
    the shadow of something outside the frame falls on the rest.
    """
    size = image.shape[0]
    x = (image.astype(np.float32) / 255) ** float(np.exp(rng.normal(0, 0.45)))
    grey = x.mean(2, keepdims=True)
    x = grey + (x - grey) * rng.uniform(0.1, 1.6)
    x = x * np.exp(rng.normal(0, 0.18, 3)).astype(np.float32)
    axis = np.linspace(-1, 1, size, dtype=np.float32)
    angle, depth = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.8)
    across = np.cos(angle) * axis[None] + np.sin(angle) * axis[:, None]
    x = x * (1 + depth * across / np.sqrt(2))[..., None]
    if rng.random() < 0.4:
        corners = rng.uniform(-0.3, 1.3, (int(rng.integers(3, 6)), 2)) * size
        shadow = np.zeros((size, size), np.float32)
        cv2.fillPoly(shadow, [corners.astype(np.int32)], 1.0)
        soft = cv2.GaussianBlur(shadow, (0, 0), float(rng.uniform(0.5, 12)) * size / 320)
        x = x * (1 - rng.uniform(0.2, 0.8) * soft[..., None])
    bright = float(np.quantile(x, 0.98)) + 1e-3
    x = x * rng.uniform(0.5, 1.4) / bright  # some are under-, some overexposed
    return np.asarray(np.clip(x, 0, 1) * 255, dtype=np.uint8)


def spoil(rng: np.random.Generator, image: Image) -> Image:
    """Add what cameras and renderers add: exposure, cast, vignette, blur, noise, compression."""
    size = image.shape[0]
    x = image.astype(np.float32) / 255
    x = x ** rng.uniform(0.7, 1.4) * rng.normal(1, 0.06, 3).astype(np.float32)
    x = x * rng.uniform(0.75, 1.2) + rng.uniform(-0.03, 0.08)
    if rng.random() < 0.4:
        axis = np.linspace(-1, 1, size, dtype=np.float32)
        fall = 1 - rng.uniform(0, 0.4) * (axis[:, None] ** 2 + axis[None] ** 2) / 2
        x = x * fall[..., None]
    if rng.random() < 0.25:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.3, 1.0) * size / 160)
    if rng.random() < 0.6:
        x = x + rng.normal(0, rng.uniform(0.005, 0.05), x.shape).astype(np.float32)
    if rng.random() < 0.1:
        x = np.repeat(x.mean(2, keepdims=True), 3, 2)
    out = (np.clip(x, 0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.4:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(40, 96))]
        packed = cv2.imencode(".jpg", out, quality)[1]
        out = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), dtype=np.uint8)
    return np.ascontiguousarray(out)
