"""Irregular things in front of a wall, photographed from the front: training images' other kind.

Heads, trophies, toys, plants, tools on a pegboard: a few overlapping noisy ellipses, at times on a
board, over wallpaper. The mask is the thing with its board.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.training_images.solids import random_colour
from mattgs_ops.segment.training_images.textures import SIZE, Bank

Image = NDArray[np.uint8]


def organic_scene(rng: np.random.Generator, side: int, bank: Bank) -> tuple[Image, Image]:
    """Draw one sample on a square canvas: RGB image and mask, both uint8."""
    image = surface(rng, side, bank.pick(rng, "wall"))
    for _ in range(int(rng.integers(0, 6))):  # frames, shelves, switches: small or cut by the edge
        centre = rng.uniform(0, 1, 2)
        centre[int(rng.integers(2))] = rng.choice([-0.02, 0.05, 0.95, 1.02])
        spot = outline(rng, centre * side, rng.uniform(0.03, 0.15, 2) * side, 0.0, box_like=True)
        cover(image, spot, surface(rng, side, bank.pick(rng, "sheet")))
    if rng.random() < 0.5:
        image = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.5, 4)) * side / 320)
    mask = np.zeros((side, side), np.uint8)
    centre = side * (0.5 + rng.normal(0, 0.05, 2))
    reach = side * rng.uniform(0.22, 0.42)
    parts = []
    if rng.random() < 0.3:  # a board behind it
        parts.append(outline(rng, centre, reach * rng.uniform(0.7, 1.1, 2), 0.03, box_like=True))
    parts.append(outline(rng, centre, reach * rng.uniform(0.45, 0.9, 2), rng.uniform(0, 0.25)))
    for _ in range(int(rng.integers(0, 6))):
        angle = rng.uniform(0, 2 * np.pi)
        away = centre + reach * rng.uniform(0.3, 0.7) * np.array([np.cos(angle), np.sin(angle)])
        parts.append(outline(rng, away, reach * rng.uniform(0.08, 0.4, 2), rng.uniform(0, 0.4)))
    for part in parts:
        cv2.fillPoly(mask, [part], 255)
    drop_shadow(rng, image, mask)
    common = random_colour(rng)
    rng.shuffle(parts)
    for part in parts:
        skin = surface(rng, side, bank.pick(rng, "object"), common if rng.random() < 0.6 else None)
        cover(image, part, rounded(rng, skin, part))
    for _ in range(int(rng.integers(0, 5))):  # eyes, knobs, marks: inside, and part of it
        spot = outline(rng, centre + rng.normal(0, 0.25, 2) * reach, reach * np.full(2, 0.07), 0.0)
        dot = np.zeros_like(mask)
        cv2.fillPoly(dot, [spot], 255)
        image[(dot > 0) & (mask > 0)] = (np.array(random_colour(rng)) * 255).astype(np.uint8)
    return image, mask


def surface(
    rng: np.random.Generator,
    side: int,
    pattern: NDArray[np.uint8],
    colour: tuple[float, float, float] | None = None,
) -> Image:
    """Colour a turned and scaled pattern to a whole canvas [S, S, 3]."""
    first = np.array(colour or random_colour(rng))
    second = np.array(random_colour(rng)) if rng.random() < 0.6 else first * rng.uniform(0.3, 0.9)
    steps = np.linspace(0, 1, 256)[:, None]
    table = ((first * steps + second * (1 - steps)) * 255).astype(np.uint8)
    angle, zoom = float(rng.uniform(0, 360)), float(rng.uniform(0.3, 2)) * side / SIZE
    matrix = cv2.getRotationMatrix2D((SIZE / 2, SIZE / 2), angle, zoom)
    size = (side, side)
    shown = cv2.warpAffine(pattern, matrix, size, borderMode=cv2.BORDER_REFLECT)
    painted: Image = table[shown]
    return painted


def outline(
    rng: np.random.Generator,
    centre: NDArray[np.float64],
    radii: NDArray[np.float64],
    roughness: float,
    *,
    box_like: bool = False,
) -> NDArray[np.int32]:
    """Return a closed noisy curve [64, 2] around ``centre``, int32 pixels."""
    angle = np.arange(64) * 2 * np.pi / 64
    x, y = np.cos(angle), np.sin(angle)
    if box_like:  # towards a rounded rectangle
        stretch = 1 / np.maximum(np.abs(x), np.abs(y)) ** rng.uniform(0.7, 1)
        x, y = x * stretch, y * stretch
    grow = np.ones(64)
    for wave in range(2, 9):
        grow += roughness / wave * rng.normal() * np.cos(wave * angle + rng.uniform(0, 2 * np.pi))
    if roughness > 0.2 and rng.random() < 0.5:
        grow += roughness * rng.uniform(0, 0.3) * rng.normal(0, 1, 64)  # tufts
    turn, grow = rng.uniform(0, np.pi), np.maximum(grow, 0.2)
    if box_like:
        turn = rng.normal(0, 0.1)
    curve = np.stack([x * radii[0], y * radii[1]], 1) * grow[:, None]
    c, s = np.cos(turn), np.sin(turn)
    points: NDArray[np.int32] = (curve @ np.array([[c, s], [-s, c]]) + centre).astype(np.int32)
    return points


def cover(image: Image, part: NDArray[np.int32], skin: Image) -> None:
    """Copy ``skin`` into ``image`` inside a curve."""
    inside = np.zeros(image.shape[:2], np.uint8)
    cv2.fillPoly(inside, [part], 255)
    cv2.copyTo(skin, inside, image)


def rounded(rng: np.random.Generator, skin: Image, part: NDArray[np.int32]) -> Image:
    """Shade a part as if it bulged: bright towards the light, dark at its far rim."""
    low, high = part.min(0), part.max(0)
    span = np.maximum(high - low, 1)
    side = skin.shape[0]
    axis = np.arange(side, dtype=np.float32)
    x = np.clip(2 * (axis - low[0]) / span[0] - 1, -1, 1)[None]
    y = np.clip(2 * (axis - low[1]) / span[1] - 1, -1, 1)[:, None]
    angle, depth = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.5)
    shade = 1 + depth * (np.cos(angle) * x + np.sin(angle) * y) - 0.4 * depth * (x * x + y * y)
    lit = skin * np.maximum(shade, 0.1)[..., None].astype(np.float32)
    return np.asarray(cv2.convertScaleAbs(lit), dtype=np.uint8)


def drop_shadow(rng: np.random.Generator, image: Image, mask: NDArray[np.uint8]) -> None:
    """Darken the wall beside the thing."""
    side = mask.shape[0]
    dx, dy = rng.normal(0, 0.04, 2) * side
    moved = cv2.warpAffine(mask, np.array([[1, 0, dx], [0, 1, dy]], np.float32), (side, side))
    soft = cv2.GaussianBlur(moved, (0, 0), float(rng.uniform(1, 10)) * side / 320)
    kept = 1 - rng.uniform(0, 0.6) * soft[..., None].astype(np.float32) / 255
    image[:] = (image * kept).astype(np.uint8)
