"""Plain grounds for training images: cloth, a white sweep, paper, a bare table, flash, a turntable.

On such grounds an object is easy to see for people and, for a network that knows cluttered desks
alone, a surprise. Pale things also lie on pale ground here, and dark ones on dark ground.
"""

from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.training_images.draw import Canvas, Light
from mattgs_ops.segment.training_images.solids import (
    Array,
    Colour,
    Face,
    cylinder,
    random_colour,
)

Kind = Literal["black", "sweep", "paper", "table", "flash"]
KINDS: tuple[Kind, ...] = ("black", "black", "sweep", "sweep", "paper", "table", "table", "flash")
Floats = NDArray[np.float32]


def random_ground(rng: np.random.Generator) -> tuple[Kind, Colour]:
    """Draw a kind of ground and its colour, RGB 0..1."""
    kind = KINDS[int(rng.integers(len(KINDS)))]
    if kind == "black":
        value = rng.uniform(0.0, 0.1) + rng.normal(0, 0.008, 3)
    elif kind == "sweep":
        value = rng.uniform(0.7, 1.0) + rng.normal(0, 0.02, 3)
    else:
        return kind, random_colour(rng)
    r, g, b = np.clip(value, 0, 1)
    return kind, (float(r), float(g), float(b))


def like_ground(rng: np.random.Generator, ground: Colour) -> list[Colour]:
    """Return one or two colours a little off the ground's: pale on pale, dark on dark."""
    colours: list[Colour] = []
    for _ in range(int(rng.integers(1, 3))):
        shift = rng.choice([-1, 1]) * rng.uniform(0.06, 0.25)
        r, g, b = np.clip(np.array(ground) + shift + rng.normal(0, 0.02, 3), 0.02, 0.98)
        colours.append((float(r), float(g), float(b)))
    return colours


def ground_light(rng: np.random.Generator, kind: Kind, eye: NDArray[np.float64]) -> Light:
    """Draw a light; a flash shines from beside the camera, with next to nothing around it."""
    light = Light.random(rng)
    if kind == "flash":
        beside = eye / np.linalg.norm(eye) + rng.normal(0, 0.06, 3)
        beside[2] = max(float(beside[2]), 0.1)
        ambient = float(rng.uniform(0.02, 0.2))
        toward = beside / np.linalg.norm(beside)
        return replace(light, direction=toward, ambient=ambient, softness=0.4)
    if kind == "sweep":  # large soft lamps
        return replace(
            light, ambient=float(rng.uniform(0.5, 0.85)), softness=float(rng.uniform(2, 8))
        )
    return light


def paint_ground(canvas: Canvas, kind: Kind, colour: Colour) -> None:
    """Cover the canvas with the ground and what stands behind it."""
    rng, side = canvas.rng, canvas.side
    tone = 255 * np.array(colour, np.float32)
    canvas.image[:] = np.clip(tone, 0, 255).astype(np.uint8)
    if kind in ("table", "flash"):
        behind = 255 * np.array(random_colour(rng), np.float32)
        canvas.image[:] = np.clip(behind, 0, 255).astype(np.uint8)
        if rng.random() < 0.5:
            canvas.wall()
            canvas.blur(float(rng.uniform(1, 6)))
        extent = float(rng.uniform(3, 9))
        if rng.random() < 0.75:
            canvas.plane("desk", extent, 0.0)
        else:
            corners = extent * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0.0]])
            canvas.draw([Face([corners], np.array([0, 0, 1.0]), colour)], is_object=False)
    folds = cv2.resize(canvas.bank.pick(rng, "folds"), (side, side)).astype(np.float32) / 255 - 0.5
    depth = rng.uniform(0, 0.5) if kind == "black" else rng.uniform(0, 0.06)
    shade = 1 + depth * folds + _slope(rng, side, 0.3 if kind == "black" else 0.18)
    if kind == "flash":
        shade = shade * _falloff(canvas)
    grain = rng.normal(0, 2.0, (side, side, 1)).astype(np.float32) if kind == "black" else 0.0
    canvas.image = np.clip(canvas.image * shade[..., None] + grain, 0, 255).astype(np.uint8)


def turntable(rng: np.random.Generator, points: Array) -> list[Face]:
    """Return a plain round plate that an object of these points [K, 3] stands on, wider than it.

    It is ground, though it stands out and has an outline of its own: its top is at height 0.
    """
    reach = float(np.linalg.norm(points[:, :2], axis=1).max())
    radius = reach * float(rng.uniform(1.05, 2.0))
    middle = np.array([*rng.normal(0, 0.06 * reach, 2), 0.0])
    below = middle - [0, 0, reach * float(rng.uniform(0.02, 0.16))]
    value = rng.choice([rng.uniform(0.02, 0.2), rng.uniform(0.75, 0.98)])  # black or white
    plain = (float(value), float(value), float(value))
    colour = plain if rng.random() < 0.6 else random_colour(rng)
    return cylinder(below, middle, radius, colour, sides=48)


def _slope(rng: np.random.Generator, side: int, depth: float) -> Floats:
    """Return a smooth change of brightness [S, S] around 0: lamps are never even."""
    axis = np.linspace(-1, 1, side, dtype=np.float32)
    a, b, c = rng.normal(0, depth, 3)
    return np.asarray(a * axis[:, None] + b * axis[None] + c * (axis[:, None] ** 2), np.float32)


def _falloff(canvas: Canvas) -> Floats:
    """Return a flash's brightness [S, S] on the ground, 1 at the origin, and on walls far away."""
    camera, side = canvas.camera, canvas.side
    rows, columns = np.mgrid[:side, :side] + 0.5
    seen = np.stack([columns - side / 2, rows - side / 2, np.zeros_like(rows)], -1)
    seen[..., :2] /= camera.scale
    seen[..., 2] = 1
    rays = seen @ camera.rotation
    reach = float(np.linalg.norm(camera.eye))
    wall = reach * canvas.rng.uniform(1.5, 5)
    length = np.linalg.norm(rays, axis=-1)
    down = np.where(rays[..., 2] < -1e-6, -camera.eye[2] / np.minimum(rays[..., 2], -1e-6), np.inf)
    away = np.minimum(down * length, wall)
    return np.asarray(np.clip((reach / away) ** 2, 0, 1.4), np.float32)
