"""Recipes for the objects of training images, and for the clutter around them.

Each recipe returns faces in world units (see ``solids``): standing on z = 0 around the origin,
roughly within a unit circle. They are families, not copies of anything: machines on wheels, legged
bodies, circuit boards, stacks of parts, frames of thin bars.
"""

from collections.abc import Callable

import numpy as np

from mattgs_ops.segment.training_images.solids import (
    Array,
    Face,
    Paint,
    bar,
    box,
    cylinder,
    frame,
    plate,
    random_colour,
    ring,
    rotation,
    up,
    wheel,
    wire,
)

Recipe = Callable[[np.random.Generator, Paint], list[Face]]
METAL = (0.72, 0.72, 0.74)
BLACK = (0.05, 0.05, 0.06)


def details(
    rng: np.random.Generator, top: Array, size: Array, paint: Paint, count: int, turn: Array
) -> list[Face]:
    """Scatter small parts on a horizontal surface: boxes, posts, pins, the fins of a heat sink."""
    faces: list[Face] = []
    for _ in range(count):
        place = rng.uniform(-0.45, 0.45, 2) * size[:2]
        at = top + turn @ np.array([place[0], place[1], 0])
        colour, use = paint.pick(rng)
        if rng.random() < 0.3:
            colour = METAL if rng.random() < 0.5 else BLACK
        kind, span = rng.random(), float(min(size[:2]))
        if kind < 0.55:
            part = span * rng.uniform(0.04, 0.3, 3) * np.array([1, 1, rng.uniform(0.2, 1.2)])
            faces += box(at + up(part[2] / 2), part, colour, use, turn)
        elif kind < 0.75:
            radius, height = span * rng.uniform(0.02, 0.09), span * rng.uniform(0.02, 0.4)
            faces += cylinder(at, at + up(height), radius, colour, sides=10)
        elif kind < 0.85:
            for k in range(int(rng.integers(3, 8))):
                fin = at + turn @ np.array([0.03 * span * k, 0, 0.05 * span])
                faces += box(fin, span * np.array([0.012, 0.2, 0.1]), colour, "", turn)
        else:
            for k in range(int(rng.integers(4, 10))):
                pin = at + turn @ np.array([0.04 * span * k, 0, 0.06 * span])
                faces += box(pin, span * np.array([0.015, 0.015, 0.12]), METAL, "", turn)
    return faces


def vehicle(rng: np.random.Generator, paint: Paint) -> list[Face]:
    """Build stacked boxes on three to eight wheels, with a mast, an arm, wires."""
    turn = rotation(rng)
    radius = rng.uniform(0.12, 0.32)
    size = np.array([rng.uniform(0.9, 1.5), rng.uniform(0.45, 0.9), rng.uniform(0.08, 0.4)])
    floor = radius * rng.uniform(0.7, 1.5)
    colour, use = paint.pick(rng)
    faces = box(np.array([0, 0, floor + size[2] / 2]), size, colour, use, turn)
    pairs = int(rng.integers(2, 5))
    rubber = Paint([random_colour(rng), *paint.colours], 0)
    for x in np.linspace(-0.5, 0.5, pairs) * size[0] * rng.uniform(0.8, 1.1):
        for side in (-1, 1):
            hub = turn @ np.array([x, side * (size[1] / 2 + 0.1), radius])
            axis = turn @ np.array([0, side, 0.0])
            faces += wheel(rng, hub, axis, radius, rng.uniform(0.06, 0.22), rubber)
            if rng.random() < 0.6:
                joint = turn @ np.array([x * 0.6, side * size[1] / 2, floor + size[2] / 2])
                faces += bar(joint, hub, rng.uniform(0.02, 0.06), paint.pick(rng)[0])
    top = np.array([0, 0, floor + size[2]])
    faces += details(rng, top, size, paint, int(rng.integers(2, 10)), turn)
    if rng.random() < 0.5:
        deck = top + up(rng.uniform(0.05, 0.2))
        faces += plate(
            rng, deck, np.array([*(size[:2] * rng.uniform(0.5, 1.1, 2)), 0]), turn, paint
        )
    return faces + extras(rng, top, size, turn, paint)


def extras(
    rng: np.random.Generator, top: Array, size: Array, turn: Array, paint: Paint
) -> list[Face]:
    """Add a mast with a head, an antenna, loops of wire."""
    faces: list[Face] = []
    if rng.random() < 0.6:
        foot = top + turn @ np.array([*(rng.uniform(-0.4, 0.4, 2) * size[:2]), 0])
        head = foot + np.array([*rng.normal(0, 0.1, 2), rng.uniform(0.2, 0.8)])
        faces += bar(foot, head, rng.uniform(0.02, 0.07), paint.pick(rng)[0])
        if rng.random() < 0.7:
            colour, use = paint.pick(rng)
            faces += box(head, rng.uniform(0.08, 0.35, 3), colour, use, turn)
    for _ in range(int(rng.integers(0, 4))):
        ends = [
            top + turn @ np.array([*(rng.uniform(-0.5, 0.5, 2) * size[:2]), -0.05])
            for _ in range(2)
        ]
        faces += wire(rng, ends[0], ends[1], paint)
    return faces


def legged(rng: np.random.Generator, paint: Paint) -> list[Face]:
    """Build a body carried by three to eight jointed legs."""
    turn, height = rotation(rng), rng.uniform(0.2, 0.6)
    radius = rng.uniform(0.22, 0.5)
    size = np.array([2 * radius, 2 * radius * rng.uniform(0.5, 1), rng.uniform(0.05, 0.3)])
    colour, use = paint.pick(rng)
    centre = np.array([0, 0, height])
    if rng.random() < 0.4:
        sides = int(rng.choice([6, 8, 16]))
        low = centre - up(size[2] / 2)
        faces = cylinder(low, low + up(size[2]), radius, colour, use, sides)
    elif rng.random() < 0.4:
        faces = []
        for level in (-0.5, 0.5):
            faces += box(centre + up(level * 0.2), size * [1, 1, 0.15], colour, use, turn)
        faces += details(rng, centre - up(0.08), size, paint, 6, turn)
    else:
        faces = box(centre, size, colour, use, turn)
    faces += details(rng, centre + up(size[2] / 2), size, paint, int(rng.integers(1, 8)), turn)
    count = int(rng.choice([3, 4, 4, 6, 6, 8]))
    knee_out, knee_up = rng.uniform(0.15, 0.45), rng.uniform(-0.05, 0.4)
    foot_out, width = rng.uniform(0.0, 0.4), rng.uniform(0.03, 0.12)
    upper, lower = paint.pick(rng)[0], paint.pick(rng)[0]
    for k in range(count):
        angle = 2 * np.pi * (k + 0.5) / count + rng.normal(0, 0.15)
        out = turn @ np.array([np.cos(angle), np.sin(angle) * size[1] / size[0], 0])
        hip = centre + out * radius
        knee = hip + out * knee_out + up(knee_up * rng.uniform(0.7, 1.3))
        foot = knee + out * foot_out * rng.uniform(0.6, 1.4)
        foot[2] = 0.0
        faces += bar(hip, knee, width, upper)
        faces += bar(knee, foot, width * rng.uniform(0.4, 1), lower)
        if rng.random() < 0.7:
            servo = width * rng.uniform(1.2, 2.2)
            for joint in (hip, knee):
                faces += box(joint, np.array([servo, servo, servo]), upper, "", rotation(rng))
        if rng.random() < 0.3:
            faces += cylinder(foot, foot + up(0.04), width * 0.8, BLACK, sides=8)
    return faces + extras(rng, centre + up(size[2] / 2), size, turn, paint)


def board(rng: np.random.Generator, paint: Paint) -> list[Face]:
    """Build a circuit board, lying or standing on posts, full of parts, sockets along its edges."""
    turn = rotation(rng)
    size = np.array([rng.uniform(1.0, 1.6), rng.uniform(0.6, 1.2), rng.uniform(0.02, 0.05)])
    post = rng.uniform(0.0, 0.12) if rng.random() < 0.6 else 0.0
    hue = np.array([(0.02, 0.35, 0.12), (0.03, 0.1, 0.4), (0.05, 0.05, 0.06), (0.5, 0.05, 0.08)])
    base = hue[int(rng.integers(4))] if rng.random() < 0.8 else np.array(random_colour(rng))
    colour = (float(base[0]), float(base[1]), float(base[2]))
    centre = np.array([0, 0, post + size[2] / 2])
    faces = box(centre, size, colour, "object", turn)
    top = np.array([0, 0, post + size[2]])
    for i in (-0.46, 0.46):
        for j in (-0.45, 0.45):
            corner = turn @ np.array([i * size[0], j * size[1], 0])
            if post:
                faces += cylinder(corner, corner + up(post), 0.03, METAL, sides=6)
            screw = ring(corner + top + up(1e-3), np.eye(3), 0.035, 10)
            faces.append(Face([screw], np.array([0, 0, 1.0]), METAL))
    faces += details(rng, top, size, paint, int(rng.integers(6, 22)), turn)
    for _ in range(int(rng.integers(2, 9))):  # sockets along the edges
        along, edge = rng.uniform(-0.42, 0.42), rng.choice([-0.46, 0.46])
        spot = np.array([along, edge]) if rng.random() < 0.5 else np.array([edge, along])
        part = np.array([*rng.uniform(0.1, 0.25, 2), rng.uniform(0.04, 0.22)])
        at = top + turn @ np.array([*(spot * size[:2]), part[2] / 2])
        faces += box(at, part, METAL if rng.random() < 0.6 else random_colour(rng), "", turn)
    for _ in range(int(rng.integers(0, 3)) if rng.random() < 0.5 else 0):
        ends = [top + turn @ np.array([*(rng.uniform(-0.5, 0.5, 2) * size[:2]), 0]) for _ in "ab"]
        faces += wire(rng, ends[0], ends[1], paint)
    return faces


def machine(rng: np.random.Generator, paint: Paint) -> list[Face]:
    """Pile boxes and cylinders on one another, with plates and wires."""
    faces: list[Face] = []
    level, turn = 0.0, rotation(rng)
    size = np.array([*rng.uniform(0.6, 1.4, 2), 0.0])
    for _ in range(int(rng.integers(1, 5))):
        height = rng.uniform(0.08, 0.6)
        colour, use = paint.pick(rng)
        shift = np.array([*rng.normal(0, 0.08, 2), 0])
        if rng.random() < 0.65:
            centre = np.array([0, 0, level + height / 2]) + shift
            faces += box(centre, np.array([size[0], size[1], height]), colour, use, turn)
        else:
            low = np.array([0, 0, level]) + shift
            taper = rng.uniform(0.5, 1.2)
            faces += cylinder(low, low + up(height), min(size[:2]) / 2, colour, use, 18, taper)
        level += height
        size = size * rng.uniform(0.5, 0.95, 3)
    top = np.array([0, 0, level])
    for _ in range(int(rng.integers(0, 4))):  # parts on the sides, lying cylinders among them
        side = turn @ np.array([*rng.uniform(-0.6, 0.6, 2), 0]) + up(rng.uniform(0.1, 0.4))
        axis = turn @ np.array([1.0, 0, 0]) * rng.uniform(0.1, 0.4)
        faces += cylinder(side - axis, side + axis, rng.uniform(0.05, 0.1), paint.pick(rng)[0])
    faces += details(rng, top, size, paint, int(rng.integers(0, 8)), turn)
    return faces + extras(rng, top, size, turn, paint)


def rack(rng: np.random.Generator, paint: Paint) -> list[Face]:
    """Build a frame of thin bars with shelves, plates with holes, and things hung in it."""
    turn = rotation(rng)
    size = np.array([*rng.uniform(0.6, 1.3, 2), rng.uniform(0.4, 1.2)])
    width, colour = rng.uniform(0.025, 0.08), paint.pick(rng)[0]
    feet = [
        turn @ (np.array([x, y, 0]) * size / 2) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    faces: list[Face] = []
    for i, foot in enumerate(feet):
        head = foot + up(size[2])
        faces += bar(foot, head, width, colour)
        following = feet[(i + 1) % 4]
        for level in (width / 2, size[2] * rng.uniform(0.4, 1), size[2]):
            faces += bar(foot + up(level), following + up(level), width, colour)
    for _ in range(int(rng.integers(1, 4))):
        shelf = np.array([0, 0, rng.uniform(0.05, 1) * size[2]])
        if rng.random() < 0.5:
            faces += plate(rng, shelf, size, turn, paint)
        else:
            faces += box(shelf, size * [1, 1, 0.03], *paint.pick(rng), turn)
        faces += details(rng, shelf, size, paint, int(rng.integers(1, 5)), turn)
    return faces + extras(rng, np.array([0, 0, size[2]]), size, turn, paint)


OBJECTS: tuple[Recipe, ...] = (vehicle, vehicle, legged, legged, board, board, machine, rack)


def clutter(rng: np.random.Generator) -> list[Face]:
    """Make one everyday thing on a desk: a book, box, mug, pen, cable, tool, or a small machine."""
    colour, kind = random_colour(rng), rng.random()
    if kind < 0.35:
        size = np.array([*rng.uniform(0.15, 0.9, 2), rng.uniform(0.02, 0.25)])
        return box(np.array([0, 0, size[2] / 2]), size, colour, "sheet", rotation(rng))
    if kind < 0.6:
        radius, height = rng.uniform(0.04, 0.22), rng.uniform(0.1, 0.6)
        end = np.array([0, 0, height])
        taper = rng.uniform(0.7, 1.2)
        return cylinder(np.zeros(3), end, radius, colour, "sheet", 16, taper)
    if kind < 0.75:
        along = rotation(rng)[:, 0] * rng.uniform(0.15, 0.45) + up(0.03)
        radius = rng.uniform(0.012, 0.05)
        return cylinder(along * [-1, -1, 1], along, radius, colour, "", 8)
    if kind < 0.9:
        faces: list[Face] = []
        at = np.array([0, 0, 0.015])
        for _ in range(int(rng.integers(4, 14))):
            step = at + frame(np.array([0, 0, 1.0])) @ [*rng.normal(0, 0.15, 2), 0]
            faces += bar(at, step, 0.02, colour)
            at = step
        return faces
    small = OBJECTS[int(rng.integers(len(OBJECTS)))](rng, Paint.random(rng))
    factor = rng.uniform(0.2, 0.45)
    for face in small:
        face.contours = [c * factor for c in face.contours]
    return small
