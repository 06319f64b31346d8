"""Families of figures for training images: animals, people, temples, vases with plants, busts.

Each recipe returns shapes (see ``figures``) that stand on z = 0 around the origin.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mattgs_ops.segment.training_images.figures import Figure, Shape
from mattgs_ops.segment.training_images.solids import (
    Array,
    Colour,
    Paint,
    frame,
    random_colour,
    rotation,
    up,
)


def random_figure(rng: np.random.Generator, colours: list[Colour] | None = None) -> Figure:
    """Draw one of the families, in the given colours, in one or in a few."""
    paint = Paint.random(rng)
    if rng.random() < 0.6:  # plaster, stone, bronze, one plastic
        paint.colours = [random_colour(rng)]
    paint.colours = colours or paint.colours
    make = FAMILIES[int(rng.integers(len(FAMILIES)))]
    turn = rotation(rng)
    shapes = [Shape(s.kind, turn @ s.centre, turn @ s.axes, s.colour) for s in make(rng, paint)]
    gloss = float(rng.uniform(0, 0.5)) if rng.random() < 0.4 else 0.0
    carved = float(rng.uniform(0, 0.35)) if rng.random() < 0.5 else 0.0
    return Figure(shapes, rng.random() < 0.3, gloss, carved)


def ball(centre: Array, radii: Array, colour: Colour, turn: Array | None = None) -> Shape:
    """Return an ellipsoid."""
    axes = (np.eye(3) if turn is None else turn) * np.asarray(radii)
    return Shape("ball", np.asarray(centre, float), axes, colour)


def limb(path: list[Array], thick: float, thin: float, colour: Colour) -> list[Shape]:
    """Return a tapering chain of ellipsoids along a path, with a ball at each joint."""
    widths = np.linspace(thick, thin, len(path))
    shapes = [ball(p, np.full(3, w), colour) for p, w in zip(path, widths, strict=True)]
    for (a, b), width in zip(pairwise(path), widths[:-1], strict=True):
        long = float(np.linalg.norm(b - a)) + 1e-6
        radii = np.array([width, width, 0.62 * long])
        shapes.append(ball((a + b) / 2, radii, colour, frame((b - a) / long)))
    return shapes


def drum(low: Array, height: float, radius: float, colour: Colour) -> Shape:
    """Return an upright cylinder from its lower end."""
    axes = np.diag([radius, radius, height / 2])
    return Shape("drum", np.asarray(low) + up(height / 2), axes, colour)


def block(centre: Array, size: Sequence[float], colour: Colour) -> Shape:
    """Return a box."""
    return Shape("block", np.asarray(centre, float), np.diag(np.asarray(size) / 2), colour)


def animal(rng: np.random.Generator, paint: Paint) -> list[Shape]:
    """Build a body on four legs with neck, head and tail."""
    skin = paint.pick(rng)[0]
    long, high = rng.uniform(0.35, 0.6), rng.uniform(0.25, 0.55)
    fat = rng.uniform(0.14, 0.26)
    shapes = [
        ball(np.array([0, 0, high]), np.array([long, fat, fat * rng.uniform(0.8, 1.3)]), skin)
    ]
    leg = rng.uniform(0.04, 0.1)
    for x in (-0.6, 0.6):
        for y in (-1, 1):
            hip = np.array([x * long, y * fat * 0.6, high])
            foot = np.array([x * long + rng.normal(0, 0.08), y * fat * rng.uniform(0.6, 1), leg])
            knee = (hip + foot) / 2 + np.array([rng.normal(0, 0.06), 0, 0])
            shapes += limb([hip, knee, foot], leg * 1.6, leg, paint.pick(rng)[0])
    chest = np.array([long * 0.8, 0, high + fat * 0.3])
    head = chest + np.array([rng.uniform(0.1, 0.4), rng.normal(0, 0.1), rng.uniform(0, 0.5)])
    shapes += limb([chest, (chest + head) / 2, head], fat * 0.7, fat * 0.35, skin)
    muzzle = head + np.array([0.1, 0, -0.02])
    shapes.append(ball(muzzle, fat * np.array([0.9, 0.5, 0.45]), skin))
    for y in (-1, 1):
        ear = head + np.array([-0.02, y * fat * 0.3, fat * 0.5])
        shapes.append(ball(ear, np.array([0.02, 0.02, rng.uniform(0.03, 0.14)]), skin))
    tail = [np.array([-long * 0.9, 0, high])]
    for _ in range(int(rng.integers(2, 5))):
        step = np.array([-rng.uniform(0.08, 0.2), rng.normal(0, 0.08), rng.normal(0, 0.1)])
        tail.append(np.maximum(tail[-1] + step, [-2, -2, 0.02]))
    return shapes + limb(tail, fat * 0.6, 0.012, skin)


def person(rng: np.random.Generator, paint: Paint) -> list[Shape]:
    """Build a standing or gesturing figurine, often on a foot plate."""
    skin, cloth = paint.pick(rng)[0], paint.pick(rng)[0]
    base = rng.uniform(0.03, 0.15) if rng.random() < 0.7 else 0.0
    shapes = [drum(np.zeros(3), base, rng.uniform(0.25, 0.4), paint.pick(rng)[0])] if base else []
    thick = rng.uniform(0.05, 0.1)
    hip = np.array([0, 0, base + rng.uniform(0.4, 0.6)])
    neck = hip + np.array([*rng.normal(0, 0.05, 2), rng.uniform(0.35, 0.5)])
    wide = np.array([thick * 1.6, thick * 2.4, 0.6 * float(neck[2] - hip[2])])
    shapes.append(ball((hip + neck) / 2, wide, cloth))
    size = rng.uniform(0.08, 0.15)
    shapes.append(ball(neck + up(size * 1.1), size * np.array([0.9, 0.8, 1.1]), skin))
    for side in (-1, 1):
        foot = np.array([rng.normal(0, 0.1), side * rng.uniform(0.05, 0.18), base + 0.03])
        knee = (hip + foot) / 2 + np.array([rng.uniform(0, 0.12), 0, 0])
        shapes += limb([hip, knee, foot], thick * 1.3, thick * 0.7, cloth)
        shoulder = neck + np.array([0, side * thick * 2.2, -0.05])
        elbow = shoulder + np.array([rng.normal(0, 0.12), side * 0.12, rng.normal(-0.1, 0.12)])
        hand = elbow + rng.normal(0, 0.14, 3)
        shapes += limb([shoulder, elbow, hand], thick * 0.8, thick * 0.45, skin)
        if rng.random() < 0.25:  # a staff or a sword
            tip = hand + np.array([rng.normal(0, 0.1), rng.normal(0, 0.1), rng.uniform(0.2, 0.5)])
            shapes += limb([2 * hand - tip, tip], 0.015, 0.012, paint.pick(rng)[0])
    return shapes


def temple(rng: np.random.Generator, paint: Paint) -> list[Shape]:
    """Build columns on steps under a roof: thin parts with the ground showing between them."""
    stone = paint.pick(rng)[0]
    size = np.array([rng.uniform(0.8, 1.4), rng.uniform(0.5, 1.0)])
    level, shapes = 0.0, []
    for _ in range(int(rng.integers(1, 4))):
        step = rng.uniform(0.04, 0.1)
        shapes.append(block(np.array([0, 0, level + step / 2]), [*size, step], stone))
        size, level = size * 0.92, level + step
    high, radius = rng.uniform(0.3, 0.9), rng.uniform(0.02, 0.08)
    columns = [int(v) for v in rng.integers(2, 6, 2)]
    for i in range(columns[0]):
        for j in range(columns[1]):
            if 0 < i < columns[0] - 1 and 0 < j < columns[1] - 1:
                continue
            if rng.random() < 0.1:
                continue  # a ruin
            spot = np.array([i / (columns[0] - 1) - 0.5, j / (columns[1] - 1) - 0.5]) * size * 0.88
            shapes.append(drum(np.array([*spot, level]), high, radius, paint.pick(rng)[0]))
    if rng.random() < 0.8:
        roof = rng.uniform(0.05, 0.2)
        at = np.array([0, 0, level + high + roof / 2])
        shapes.append(block(at, [*size, roof], stone))
    return shapes


def vase(rng: np.random.Generator, paint: Paint) -> list[Shape]:
    """Build a vessel of stacked rounds, at times with a plant of thin stems in it."""
    level, shapes = 0.0, []
    for _ in range(int(rng.integers(1, 4))):
        wide, tall = rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.45)
        colour = paint.pick(rng)[0]
        if rng.random() < 0.5:
            shapes.append(ball(up(level + tall / 2), np.array([wide, wide, 0.6 * tall]), colour))
        else:
            shapes.append(drum(up(level), tall, wide, colour))
        level += tall
    if rng.random() < 0.6:
        for _ in range(int(rng.integers(3, 9))):
            path = [up(level * 0.9)]
            for _ in range(3):
                path.append(path[-1] + np.array([*rng.normal(0, 0.1, 2), rng.uniform(0.05, 0.2)]))
            colour = paint.pick(rng)[0]
            shapes += limb(path, 0.015, 0.01, colour)
            if rng.random() < 0.8:
                leaf = np.array([rng.uniform(0.03, 0.12), rng.uniform(0.02, 0.06), 0.02])
                shapes.append(ball(path[-1], leaf, paint.pick(rng)[0], rotation(rng, 0.8)))
    return shapes


def bust(rng: np.random.Generator, paint: Paint) -> list[Shape]:
    """Build a lumpy head, stone or trunk of many overlapping rounds."""
    shapes, middle = [], up(rng.uniform(0.35, 0.55))
    size = np.array([*rng.uniform(0.25, 0.4, 2), middle[2]])
    colour = paint.pick(rng)[0]
    shapes.append(ball(middle, size, colour))
    for _ in range(int(rng.integers(4, 14))):
        ray = rng.normal(0, 1, 3)
        spot = middle + size * ray / np.linalg.norm(ray) * rng.uniform(0.6, 1.0)
        radii = rng.uniform(0.04, 0.2, 3)
        spot[2] = max(float(spot[2]), float(radii.max()))
        shapes.append(ball(spot, radii, paint.pick(rng)[0], rotation(rng, 0.6)))
    if rng.random() < 0.5:
        shapes.append(drum(np.zeros(3), rng.uniform(0.05, 0.2), rng.uniform(0.2, 0.4), colour))
    return shapes


FAMILIES = (animal, animal, person, person, temple, vase, bust)
