"""Procedural patterns for training images: scalar maps that are coloured when they are used.

A pattern is [256, 256] uint8; a surface mixes two colours by it. One small bank of patterns with
fresh colours, scales and positions for every surface gives endless variety at no cost.
"""

from collections.abc import Callable
from functools import lru_cache
from itertools import chain
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE = 256
Pattern = NDArray[np.uint8]
_LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-./:"


def fractal(rng: np.random.Generator, roughness: float = 0.6, stretch: int = 1) -> Pattern:
    """Sum of smoothed random grids; ``stretch`` > 1 draws it out sideways (brushed metal)."""
    total = np.zeros((SIZE, SIZE), np.float32)
    weight = 1.0
    for cells in (4, 8, 16, 32, 64, 128):
        grid = rng.random((cells, max(2, cells // stretch)), dtype=np.float32)
        total += weight * cv2.resize(grid, (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)
        weight *= roughness
    return stretched(total)


def wood(rng: np.random.Generator) -> Pattern:
    """Draw growth rings bent by noise, with planks at times."""
    bend = fractal(rng, 0.4, 8).astype(np.float32) / 255
    y = np.linspace(0, 1, SIZE, dtype=np.float32)[:, None]
    rings = np.sin((y * rng.uniform(3, 14) + bend * rng.uniform(1, 4)) * 2 * np.pi)
    grain = rings + rng.uniform(0.3, 1.5) * fractal(rng, 0.9, 16).astype(np.float32) / 128
    if rng.random() < 0.5:
        for row in range(0, SIZE, int(rng.integers(32, 90))):
            grain[row:] += rng.normal(0, 0.5)
            grain[row : row + 2] -= 2
    return stretched(grain)


def page(rng: np.random.Generator) -> Pattern:
    """Draw lines of text, headings and a picture, as on paper."""
    sheet = np.full((SIZE, SIZE), 255, np.uint8)
    y = int(rng.integers(12, 24))
    while y < SIZE - 4:
        scale = 0.8 if rng.random() < 0.15 else float(rng.uniform(0.25, 0.45))
        if rng.random() < 0.08:
            height = int(rng.integers(20, 60))
            cv2.rectangle(sheet, (20, y), (int(rng.integers(100, 236)), y + height), 120, -1)
            y += height + 14
            continue
        cv2.putText(sheet, letters(rng, 40), (12, y), cv2.FONT_HERSHEY_SIMPLEX, scale, 30, 1)
        y += int(30 * scale) + 4
    return sheet


def poster(rng: np.random.Generator) -> Pattern:
    """Draw overlapping flat shapes and words: a book cover, a box, a screen."""
    sheet = np.full((SIZE, SIZE), int(rng.integers(0, 256)), np.uint8)
    for _ in range(int(rng.integers(4, 14))):
        x, y, w, h = (int(v) for v in rng.integers(0, SIZE, 4))
        shade = int(rng.integers(0, 256))
        if rng.random() < 0.5:
            cv2.rectangle(sheet, (x, y), (x + w // 2, y + h // 2), shade, -1)
        else:
            cv2.ellipse(sheet, (x, y), (w // 4 + 2, h // 4 + 2), 0, 0, 360, shade, -1)
    for _ in range(int(rng.integers(0, 4))):
        at = (int(rng.integers(0, 100)), int(rng.integers(20, SIZE)))
        cv2.putText(sheet, letters(rng, 10), at, cv2.FONT_HERSHEY_DUPLEX, 1.1, 250, 2)
    return sheet


def lattice(rng: np.random.Generator) -> Pattern:
    """Repeat a motif: stripes, checks, dots, a grid, keys; wallpaper, cloth, a cutting mat."""
    step = int(rng.choice([8, 16, 32, 64]))
    tile = np.zeros((step, step), np.uint8)
    kind = rng.integers(0, 6)
    if kind == 0:
        tile[: step // 2] = 255
    elif kind == 1:
        tile[: step // 2, : step // 2] = tile[step // 2 :, step // 2 :] = 255
    elif kind == 2:
        cv2.circle(tile, (step // 2, step // 2), max(2, step // 3), 255, -1)
    elif kind == 3:
        tile[: max(1, step // 16)] = tile[:, : max(1, step // 16)] = 255
    elif kind == 4:
        cv2.rectangle(tile, (1, 1), (step - 3, step - 3), 255, -1)
    else:
        for _ in range(4):
            p, q = rng.integers(0, step, 2), rng.integers(1, step // 2 + 1, 2)
            centre, axes = (int(p[0]), int(p[1])), (int(q[0]), int(q[1]))
            angle, shade = float(rng.uniform(0, 180)), int(rng.integers(60, 256))
            cv2.ellipse(tile, centre, axes, angle, 0, 360, shade, 1 + step // 24)
    return np.tile(tile, (SIZE // step, SIZE // step))


def traces(rng: np.random.Generator) -> Pattern:
    """Draw a circuit board's copper: bent lines, pads, drill holes, lettering."""
    sheet = np.full((SIZE, SIZE), 60, np.uint8)
    for _ in range(60):
        x, y = (int(v) for v in rng.integers(0, SIZE, 2))
        a, b = (int(v) for v in rng.integers(-50, 50, 2))
        corners = np.array([[x, y], [x + a, y], [x + a + b, y + b]], np.int32)
        cv2.polylines(sheet, [corners], False, int(rng.integers(80, 130)), int(rng.integers(1, 3)))
        cv2.circle(sheet, (x, y), int(rng.integers(1, 5)), int(rng.integers(150, 256)), -1)
    for _ in range(10):
        at = (int(rng.integers(0, SIZE)), int(rng.integers(0, SIZE)))
        cv2.putText(sheet, letters(rng, 4), at, cv2.FONT_HERSHEY_PLAIN, 0.8, 250, 1)
    return sheet


def fur(rng: np.random.Generator) -> Pattern:
    """Draw short strokes along a slowly turning direction: hair, grass, carpet, cloth."""
    sheet = fractal(rng, 0.5)
    turn = fractal(rng, 0.3).astype(np.float32) / 255 * rng.uniform(0.5, 4) * np.pi
    places = rng.integers(0, SIZE, (900, 2))
    angles = turn[places[:, 1], places[:, 0]]
    for (x, y), right, down in zip(places.tolist(), np.cos(angles), np.sin(angles), strict=True):
        length = rng.uniform(4, 12)
        end = (int(x + float(length * right)), int(y + float(length * down)))
        cv2.line(sheet, (x, y), end, int(rng.integers(0, 256)), 1)
    return np.asarray(cv2.GaussianBlur(sheet, (3, 3), 0), dtype=np.uint8)


def cells(rng: np.random.Generator) -> Pattern:
    """Draw flat patches around random points: stone, leather, camouflage."""
    points = rng.random((40, 2)).astype(np.float32)
    shades = rng.random(40).astype(np.float32)
    axis = np.linspace(0, 1, SIZE // 2, dtype=np.float32)
    away = (axis[:, None, None] - points[:, 1]) ** 2 + (axis[None, :, None] - points[:, 0]) ** 2
    patches = cv2.resize(stretched(shades[away.argmin(2)]), (SIZE, SIZE))
    return np.asarray(patches, dtype=np.uint8)


def speckle(rng: np.random.Generator) -> Pattern:
    """Draw granite, terrazzo, dust."""
    sheet = np.full((SIZE, SIZE), 128, np.uint8)
    for x, y in rng.integers(0, SIZE, (500, 2)):
        radius, shade = int(rng.integers(1, 4)), int(rng.integers(0, 256))
        cv2.circle(sheet, (int(x), int(y)), radius, shade, -1)
    return sheet


def slope(rng: np.random.Generator) -> Pattern:
    """Draw a smooth gradient with faint noise: painted or moulded surfaces."""
    axis = np.linspace(-1, 1, SIZE, dtype=np.float32)
    angle = rng.uniform(0, 2 * np.pi)
    ramp = np.cos(angle) * axis[:, None] + np.sin(angle) * axis[None]
    return stretched(ramp + 0.4 * fractal(rng, 0.9) / 255)


def stretched(values: NDArray[np.floating[Any]]) -> Pattern:
    """Scale to the whole range 0 to 255."""
    low, high = float(values.min()), float(values.max())
    scaled: Pattern = ((values - low) * (255 / max(high - low, 1e-6))).astype(np.uint8)
    return scaled


def letters(rng: np.random.Generator, count: int) -> str:
    """Return words of random letters."""
    picked = rng.integers(0, len(_LETTERS), count)
    return "".join(" " if rng.random() < 0.15 else _LETTERS[i] for i in picked)


_Maker = Callable[[np.random.Generator], Pattern]
_MAKERS: dict[str, tuple[_Maker, ...]] = {
    # what objects are made of, what they stand on, what lies or hangs around them
    "object": (fractal, slope, slope, traces, poster, lattice, speckle, fur, page),
    "desk": (wood, wood, fractal, lattice, speckle, cells, fur, slope),
    "sheet": (page, page, poster, poster, lattice, slope, fractal),
    "wall": (lattice, fractal, slope, poster, cells, fur, wood, page),
}


class Bank:
    """Patterns by use: ``object``, ``desk``, ``sheet``, ``wall``, ``folds``; made from a seed."""

    def __init__(self, seed: int, per_maker: int = 3) -> None:
        self.patterns = _drawn(seed, per_maker)

    def pick(self, rng: np.random.Generator, use: str) -> Pattern:
        """Return a random pattern for a use."""
        patterns = self.patterns[use]
        return patterns[int(rng.integers(len(patterns)))]


@lru_cache(maxsize=2)  # those to train on and those to validate with are often of one seed
def _drawn(seed: int, per_maker: int) -> dict[str, tuple[Pattern, ...]]:
    rng = np.random.default_rng(seed)
    patterns = {
        use: [maker(rng) for maker in makers for _ in range(per_maker)]
        for use, makers in _MAKERS.items()
    }
    patterns["object"] += [fractal(rng, 0.9, 32) for _ in range(per_maker)]
    patterns["folds"] = [fractal(rng, 0.35, 1 + k % 3) for k in range(2 * per_maker)]
    for pattern in chain.from_iterable(patterns.values()):
        pattern.flags.writeable = False  # every bank of this seed has them
    return {use: tuple(some) for use, some in patterns.items()}
