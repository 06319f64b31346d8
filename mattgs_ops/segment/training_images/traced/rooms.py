"""Rooms for traced views: a floor or a table or a pedestal between walls, with things around.

Real photos of things show more than a desk: walls with pictures, a floor, furniture, other statues
of the same kind, lamps and windows of any brightness, and mostly a background out of focus. All of
that is ground here, what the object stands on included. Lengths are centimetres, the object stands
on z = 0 at the origin; cameras stay within ``ORBIT`` of it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator

from mattgs_ops.segment.training_images.figure_families import random_figure
from mattgs_ops.segment.training_images.organic import surface
from mattgs_ops.segment.training_images.solids import Paint
from mattgs_ops.segment.training_images.textures import Bank
from mattgs_ops.segment.training_images.things import OBJECTS
from mattgs_ops.segment.training_images.traced.objects import (
    put_figure,
    put_sculpture,
    put_thing,
)
from mattgs_ops.synthetic.surfaces.materials import Material, Stage, pose
from mattgs_ops.synthetic.surfaces.mesh import Array, Mesh, box, cylinder, quad, rotation
from mattgs_ops.synthetic.surroundings import clutter, furniture
from mattgs_ops.synthetic.surroundings.grounds import Ground, flash_light

ORBIT = 95.0  # farther than any camera
SIDE = 384  # pixels of a surface's texture
SHARES = (0.2, 0.45, 0.35)  # floor, table, pedestal
FLASHES = 0.12  # share of rooms lit by the camera
OUT_OF_FOCUS = 0.45  # share of rooms
WINDOWS = 0.5  # share of rooms with one
LAMP, WINDOW = 12.0, 9.0  # radiance; photos are exposed by what they show
SILL = 45.0  # height of a window's middle
SMALL = (furniture.mug, furniture.book_pile, clutter.tape, clutter.parts_box, clutter.cable)
SCULPTED, FIGURES = 0.55, 0.2  # shares of objects in rooms; the rest are things with flat faces


@dataclass(frozen=True)
class Room:
    """``ground`` as the tracer takes it; ``aperture`` is the lens's radius, 0 for all in focus.

    ``lowest`` is the least elevation of a camera, degrees.
    """

    ground: Ground
    aperture: float
    lowest: float


def lay_room(rng: Generator, bank: Bank) -> Room:
    """Build a room around the origin."""
    stage, kind = Stage(), int(rng.choice(3, p=SHARES))
    drop = (0.0, 75.0, float(rng.uniform(25, 110)))[kind]
    half = rng.uniform(150, 330, 2)
    height = float(rng.uniform(90, 220))
    _close(stage, half, -drop, height, rng, bank)
    if kind == 1:
        _table(stage, rng, bank)
    elif kind == 2:
        _pedestal(stage, drop, rng, bank)
    if rng.random() < 0.35:
        wide, deep = rng.uniform(25, 60, 2)
        turn, (x, y) = float(rng.uniform(0, 360)), rng.normal(0, 4, 2)
        sheet = quad(wide, deep).turned(z=turn).at(x, y, 0.03)
        stage.add(sheet, _covered("sheet", rng, bank), own=False)
    for _ in range(int(rng.integers(3, 10))):
        _far_thing(stage, half, drop, kind == 2, rng, bank)
    flash = bool(rng.random() < FLASHES)
    light = flash_light() if flash else _lamps(half, height, rng)
    aperture = float(rng.uniform(0.4, 1.6)) if rng.random() < OUT_OF_FOCUS else 0.0
    top = 0.04
    return Room(Ground(stage, light, top, flash=flash), aperture, 8.0 if kind == 0 else -6.0)


def put_random(stage: Stage, top: float, scale: float, bank: Bank, rng: Generator) -> Array:
    """Put an object of a random kind on the stage; return points [K, 3] around it."""
    kind = rng.random()
    if kind < SCULPTED:
        return scale * put_sculpture(stage, top, scale, bank, rng) + [0, 0, top]
    if kind < SCULPTED + FIGURES:
        figure = random_figure(rng)
        put_figure(stage, figure, top, scale, bank, rng)
        return scale * figure.points + [0, 0, top]
    thing = OBJECTS[int(rng.integers(len(OBJECTS)))](rng, Paint.random(rng))
    put_thing(stage, thing, top, scale, bank, rng)
    return scale * np.concatenate([face.contours[0] for face in thing]) + [0, 0, top]


def _covered(use: str, rng: Generator, bank: Bank, roughness: float = 0.6) -> Material:
    """Return a surface of a pattern in two colours, or nearly of one colour."""
    tone = (float(rng.uniform(0.05, 0.9)) + rng.normal(0, 0.05, 3)).clip(0.02, 0.95)
    colour = (float(tone[0]), float(tone[1]), float(tone[2]))
    image = surface(rng, SIDE, bank.pick(rng, use), colour)
    if rng.random() < 0.4:  # many walls, floors and cloths are calm
        faint = float(rng.uniform(0.02, 0.3))
        image = (faint * image + (1 - faint) * 255 * tone).astype(np.uint8)
    return Material(image, roughness)


def _close(
    stage: Stage, half: Array, floor: float, height: float, rng: Generator, bank: Bank
) -> None:
    """Put up a floor, four walls with pictures and a ceiling."""
    stage.add(quad(*(2 * half)).at(z=floor), _covered("desk", rng, bank), own=False)
    stage.add(quad(*(2 * half)).turned(x=180).at(z=height), _covered("wall", rng, bank), own=False)
    walls = _covered("wall", rng, bank)
    for turn in (0, 90, 180, 270):
        wide, away = half if turn % 180 == 0 else half[::-1]
        inner = quad(2 * wide, height - floor).turned(x=90).at(y=away, z=(height + floor) / 2)
        paint = walls if rng.random() < 0.8 else _covered("wall", rng, bank)
        stage.add(inner.turned(z=turn), paint, own=False)
        for _ in range(int(rng.integers(0, 4))):
            size = rng.uniform(20, 110, 2)
            at = rng.uniform(-0.8, 0.8) * wide, rng.uniform(-10, 60)
            hung = box(size[0], size[1], 2, 0.2).turned(x=90).at(at[0], away - 0.5, at[1])
            stage.add(hung.turned(z=turn), _covered("sheet", rng, bank, 0.4), own=False)


def _table(stage: Stage, rng: Generator, bank: Bank) -> None:
    """Put a table under the origin, with a few things on it beside the object."""
    size = rng.uniform((70, 60), (180, 110))
    board = _covered("desk", rng, bank, float(rng.uniform(0.25, 0.8)))
    left, front = rng.normal(0, 6, 2)
    stage.add(quad(*size).at(left, front), board, own=False)
    stage.add(box(size[0], size[1], 3, 0.2).at(left, front, -3.01), board, own=False)
    for side in (-1, 1):
        foot = left + side * (size[0] / 2 - 8)
        leg = box(6, 0.8 * size[1], 72, 0.2).at(foot, front, -75)
        stage.add(leg, board, own=False)
    for _ in range(int(rng.integers(0, 6))):
        around, far = rng.uniform(0, 2 * np.pi), rng.uniform(20, 34)
        x, y = far * np.cos(around), far * np.sin(around)
        if rng.random() < 0.5:
            item = SMALL[int(rng.integers(len(SMALL)))](rng)
            turn = float(rng.uniform(0, 360))
            item.group.place(stage, pose(x, y, 0.02, rotation(z=turn)), own=False)
        else:
            beside = Stage()
            put_random(beside, 0.02, float(rng.uniform(3, 7)), bank, rng)
            _move(beside, stage, x, y)


def _pedestal(stage: Stage, drop: float, rng: Generator, bank: Bank) -> None:
    """Put a block or a drum under the origin, at times with a wider plinth."""
    stone = _covered("desk" if rng.random() < 0.3 else "wall", rng, bank)
    stage.add(_post(float(rng.uniform(11, 22)), drop, rng), stone, own=False)
    if rng.random() < 0.4:
        stage.add(box(70, 70, 8, 0.5).at(z=-drop), stone, own=False)


def _post(radius: float, height: float, rng: Generator) -> Mesh:
    """Return a square or round post whose top is at z = 0."""
    if rng.random() < 0.5:
        return cylinder(radius, height, 0.3, 48).at(z=-height)
    long = radius * float(rng.uniform(1, 1.6))
    return box(2 * radius, 2 * long, height, 0.3).turned(z=float(rng.uniform(0, 90))).at(z=-height)


def _far_thing(
    stage: Stage, half: Array, drop: float, museum: bool, rng: Generator, bank: Bank
) -> None:
    """Stand a piece of furniture or another object beyond the cameras."""
    around = rng.uniform(0, 2 * np.pi)
    ray = np.array([np.cos(around), np.sin(around)])
    edge = float((half / np.maximum(np.abs(ray), 1e-6)).min())
    kind = rng.random()
    size = rng.uniform((20, 20, 30), (90, 60, 190)) if kind < 0.5 else np.array([30.0, 30, 0])
    far = max(ORBIT + size[:2].max() / 2, edge * float(rng.uniform(0.5, 0.9)))
    x, y = far * ray
    if kind < 0.5:
        wide, deep, high = size
        block = box(wide, deep, high, 0.4).turned(z=float(rng.uniform(0, 360))).at(x, y, -drop)
        stage.add(block, _covered("sheet" if rng.random() < 0.3 else "desk", rng, bank), own=False)
        return
    top = -drop
    if museum or rng.random() < 0.5:
        top = float(rng.uniform(-20, 20)) - min(drop, 20)
        post = _post(float(rng.uniform(15, 30)), top + drop + 1, rng)
        stage.add(post.at(x, y, top), _covered("wall", rng, bank), own=False)
    other = Stage()
    put_random(other, top, float(rng.uniform(10, 45)), bank, rng)
    _move(other, stage, x, y)


def _move(group: Stage, stage: Stage, x: float, y: float) -> None:
    """Put what stands on another stage on this one, as ground."""
    for (material, part, _), meshes in group.pieces.items():
        for mesh in meshes:
            stage.add(mesh.at(x, y), material, part, own=False)


def _lamps(half: Array, height: float, rng: Generator) -> dict[str, Any]:
    """Return one to three lamps on the ceiling and at times a window, each of its own colour."""
    import mitsuba as mi

    light: dict[str, Any] = {
        "sky": {
            "type": "constant",
            "radiance": {"type": "rgb", "value": [float(rng.uniform(0.02, 0.3))] * 3},
        }
    }
    places: list[tuple[list[float], list[float], Array, float]] = []
    for _ in range(int(rng.integers(1, 4))):
        x, y = rng.uniform(-0.8, 0.8, 2) * half
        places.append(([x, y, height - 2], [x, y, 0.0], rng.uniform(8, 50, 2), LAMP))
    if rng.random() < WINDOWS:
        side, along = int(rng.choice([-1, 1])), float(rng.uniform(-0.7, 0.7))
        x, y = side * (half[0] - 2), along * half[1]
        places.append(([x, y, SILL], [0.0, y, SILL], rng.uniform(30, 70, 2), WINDOW))
    for k, (place, target, size, strength) in enumerate(places):
        frame = mi.ScalarTransform4f().look_at(place, target, [0.3, 0.9, 0.1])
        glow = strength * float(rng.uniform(0.3, 2)) * np.exp(rng.normal(0, 0.08, 3))
        light[f"lamp{k}"] = {
            "type": "rectangle",
            "to_world": frame.scale([float(size[0]), float(size[1]), 1.0]),
            "emitter": {
                "type": "area",
                "radiance": {"type": "rgb", "value": [float(v) for v in glow]},
            },
        }
    return light
