"""Solids for training images: flat faces in space, made into machines, boards, robots, clutter.

World: x, y on the ground, z up, the object about one unit wide, standing at the origin. A face is
one outer contour and any number of holes, each [K, 3] float64 in one plane, with an outward normal
(zero for faces seen from both sides).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Colour = tuple[float, float, float]


@dataclass
class Face:
    """``contours[0]`` is the outline, the rest are holes; colours are RGB 0..1."""

    contours: list[Array]
    normal: Array
    colour: Colour
    use: str = ""  # which patterns may cover it; empty: plain
    decal: bool = False  # painted on another face: drawn right after it


@dataclass
class Paint:
    """An object's few colours, so that its parts belong together."""

    colours: list[Colour]
    textured: float  # share of faces that carry a pattern

    @classmethod
    def random(cls, rng: np.random.Generator) -> "Paint":
        """Draw two to four colours: bright, dark, metallic or white ones."""
        count = int(rng.integers(2, 5))
        return cls([random_colour(rng) for _ in range(count)], float(rng.uniform(0.1, 0.7)))

    def pick(self, rng: np.random.Generator) -> tuple[Colour, str]:
        """Return a colour and a pattern's use for one part."""
        use = "object" if rng.random() < self.textured else ""
        return self.colours[int(rng.integers(len(self.colours)))], use


def random_colour(rng: np.random.Generator) -> Colour:
    """Return a colour as things have them: a third dark, a quarter grey or white, the rest any."""
    kind = rng.random()
    if kind < 0.3:
        value = rng.uniform(0.02, 0.2) + rng.normal(0, 0.02, 3)
    elif kind < 0.6:
        value = rng.uniform(0.3, 0.95) + rng.normal(0, 0.03, 3)
    else:
        value = rng.uniform(0.05, 0.95, 3)
    r, g, b = np.clip(value, 0, 1)
    return float(r), float(g), float(b)


def rotation(rng: np.random.Generator, tilt: float = 0.0) -> Array:
    """Return a turn about z, then a small tilt, [3, 3]."""
    a, b = rng.uniform(0, 2 * np.pi), rng.normal(0, tilt) if tilt else 0.0
    c, s, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return np.asarray(turn @ np.array([[1, 0, 0], [0, cb, -sb], [0, sb, cb]]))


_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], float)


def box(
    centre: Array, size: Array, colour: Colour, use: str = "", turn: Array | None = None
) -> list[Face]:
    """Return six faces; ``turn`` [3, 3] is applied about the centre."""
    turn = np.eye(3) if turn is None else turn
    corners = (_SIGNS * np.asarray(size) / 2) @ turn.T + centre
    normals = _NORMALS @ turn.T
    return [
        Face([corners[list(quad)]], n, colour, use) for quad, n in zip(_QUADS, normals, strict=True)
    ]


def bar(start: Array, end: Array, width: float, colour: Colour, use: str = "") -> list[Face]:
    """Return a square rod between two points."""
    along = np.asarray(end) - start
    length = float(np.linalg.norm(along)) + 1e-9
    turn = frame(along / length)
    size = np.array([width, width, length])
    return box((np.asarray(start) + end) / 2, size, colour, use, turn)


def frame(axis: Array) -> Array:
    """Return an orthonormal frame [3, 3] whose third column is ``axis``."""
    side = np.cross(axis, [0, 0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0, 0])
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(axis, side), axis], axis=1)


def cylinder(
    start: Array,
    end: Array,
    radius: float,
    colour: Colour,
    use: str = "",
    sides: int = 14,
    taper: float = 1.0,
) -> list[Face]:
    """Return a prism of ``sides`` sides; ``taper`` scales the far end's radius."""
    axis = np.asarray(end, float) - start
    axis /= np.linalg.norm(axis) + 1e-9
    turn = frame(axis)
    angles = np.arange(sides) * 2 * np.pi / sides
    around = np.cos(angles)[:, None] * turn[:, 0] + np.sin(angles)[:, None] * turn[:, 1]
    low, high = start + radius * around, end + radius * taper * around
    faces = []
    for i in range(sides):
        j = (i + 1) % sides
        outward = around[i] + around[j]
        outward /= np.linalg.norm(outward)
        faces.append(Face([np.stack([low[i], low[j], high[j], high[i]])], outward, colour, use))
    return [*faces, Face([low], -axis, colour, use), Face([high], axis, colour, use)]


def wheel(
    rng: np.random.Generator, centre: Array, axis: Array, radius: float, width: float, paint: Paint
) -> list[Face]:
    """Return a tyre with a hub, spokes or openings, at times openings that one sees through."""
    axis = axis / np.linalg.norm(axis)
    tyre = paint.colours[0] if rng.random() < 0.4 else (0.06, 0.06, 0.07)
    hub, _ = paint.pick(rng)
    faces = cylinder(centre - axis * width / 2, centre + axis * width / 2, radius, tyre, sides=18)
    turn, count = frame(axis), int(rng.integers(3, 8))
    see_through = rng.random() < 0.35
    openings = []
    for k in range(count):
        a = 2 * np.pi * k / count
        middle = radius * 0.5 * (np.cos(a) * turn[:, 0] + np.sin(a) * turn[:, 1])
        openings.append(ring(middle, turn, radius * rng.uniform(0.12, 0.2), 8))
    for cap, side in ((faces[-2], -1), (faces[-1], 1)):
        face_centre = centre + side * axis * width / 2
        holes = [face_centre + o for o in openings]
        disc = face_centre + ring(np.zeros(3), turn, radius * 0.78, 16)
        if see_through:
            cap.contours += holes
        decal = Face([disc, *(holes if see_through else [])], cap.normal, hub, decal=True)
        faces.append(decal)
        if not see_through:
            dark = (0.05, 0.05, 0.05)
            faces += [Face([h], cap.normal, dark, decal=True) for h in holes]
    return faces


def ring(centre: Array, turn: Array, radius: float, sides: int) -> Array:
    """Return points on a circle in the plane of the frame's first two columns, [sides, 3]."""
    angles = np.arange(sides) * 2 * np.pi / sides
    plane = np.cos(angles)[:, None] * turn[:, 0] + np.sin(angles)[:, None] * turn[:, 1]
    return np.asarray(centre + radius * plane)


def plate(
    rng: np.random.Generator, centre: Array, size: Array, turn: Array, paint: Paint
) -> list[Face]:
    """Return a thin sheet with holes that show what is behind it."""
    colour, use = paint.pick(rng)
    half = np.asarray(size) / 2
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
    outline = square @ turn.T + centre
    holes = []
    columns, rows = (int(v) for v in rng.integers(1, 4, 2))
    for i in range(columns):
        for j in range(rows):
            middle = np.array([(2 * i + 1) / columns - 1, (2 * j + 1) / rows - 1, 0]) * half
            radius = min(half[0] / columns, half[1] / rows) * rng.uniform(0.3, 0.75)
            holes.append(ring(turn @ middle + centre, turn, radius, int(rng.choice([4, 6, 12]))))
    normal = np.zeros(3)
    return [Face([outline, *holes], normal, colour, use)]


def wire(rng: np.random.Generator, start: Array, end: Array, paint: Paint) -> list[Face]:
    """Return a sagging or arching cable of short thin rods."""
    colour = random_colour(rng) if rng.random() < 0.5 else paint.pick(rng)[0]
    lift = rng.normal(0, 0.2)
    times = np.linspace(0, 1, 7)[:, None]
    path = start + (end - start) * times + np.array([0, 0, lift]) * 4 * times * (1 - times)
    path[:, 2] = np.maximum(path[:, 2], 0.01)
    width = float(rng.uniform(0.008, 0.025))
    return [f for a, b in pairwise(path) for f in bar(a, b, width, colour)]


def up(height: float) -> Array:
    """Return the vector [0, 0, height]."""
    return np.array([0.0, 0.0, height])
