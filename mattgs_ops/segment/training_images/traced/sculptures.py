"""Sculpted things for traced views: heads, skulls, stones, tools, branches, gowns, and figures.

Each family returns solid shapes and hollows, which ``skin`` melts into one surface. World as in
``figures``: z up, standing on z = 0 around the origin, about one unit wide.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from mattgs_ops.segment.training_images.figure_families import (
    animal,
    ball,
    block,
    bust,
    drum,
    limb,
    person,
    vase,
)
from mattgs_ops.segment.training_images.figures import Shape
from mattgs_ops.segment.training_images.solids import Array, Colour, Paint, rotation, up
from mattgs_ops.segment.training_images.traced.skin import dent, melt
from mattgs_ops.synthetic.surfaces.mesh import Mesh

GREY: Colour = (0.5, 0.5, 0.5)  # shapes need a colour, the skin has its own

Shapes = list[Shape]
Family = Callable[[np.random.Generator], tuple[Shapes, Shapes]]  # solid shapes, and hollows


def random_sculpture(rng: np.random.Generator) -> Mesh:
    """Draw one of the families, melt it, dent it, turn it; the lowest point is on z = 0."""
    solids, hollows = FAMILIES[int(rng.integers(len(FAMILIES)))](rng)
    mesh = melt(solids, hollows, blend=float(rng.uniform(0.01, 0.09)))
    size = float(np.ptp(mesh.vertices, axis=0).max())
    depth = size * float(rng.choice([0.0, 0.006, 0.015, 0.035])) * rng.uniform(0.5, 1.5)
    mesh = dent(mesh, rng, depth, falloff=float(rng.uniform(0.35, 0.75)))
    turned = mesh.transformed(np.block([[rotation(rng), np.zeros((3, 1))], [0, 0, 0, 1]]))
    return turned.at(z=-float(turned.vertices[:, 2].min()))


def _off(point: Array, x: float, y: float, z: float) -> Array:
    """Return the point moved."""
    return np.asarray(point + np.array([x, y, z]))


def _painted(make: Callable[[np.random.Generator, Paint], Shapes]) -> Family:
    return lambda rng: (make(rng, Paint([GREY], 0.0)), [])


def head(rng: np.random.Generator) -> tuple[Shapes, Shapes]:
    """Build a head: skull, jaw, nose, brow, ears, hair, a neck, at times shoulders and a socle."""
    wide, deep, tall = rng.uniform(0.2, 0.27), rng.uniform(0.24, 0.32), rng.uniform(0.28, 0.38)
    base = rng.uniform(0.1, 0.3) if rng.random() < 0.5 else 0.0
    neck = base + rng.uniform(0.1, 0.3)
    middle = np.array([0, 0, neck + tall])
    shapes = [
        ball(middle, np.array([deep, wide, tall]), GREY),
        ball(
            _off(middle, deep * 0.35, 0, -tall * 0.6),
            np.array([0.5 * deep, 0.7 * wide, 0.4 * tall]),
            GREY,
        ),
        ball(
            _off(middle, deep * 1.0, 0, -tall * 0.12),
            np.array([0.06, 0.035, rng.uniform(0.07, 0.12)]),
            GREY,
        ),
        ball(_off(middle, deep * 0.85, 0, tall * 0.15), np.array([0.06, 0.15, 0.035]), GREY),
        ball(_off(middle, deep * 0.9, 0, -tall * 0.48), np.array([0.05, 0.08, 0.03]), GREY),
        drum(np.array([0, 0, base]), neck + tall * 0.6 - base, rng.uniform(0.1, 0.17), GREY),
    ]
    shapes += [
        ball(_off(middle, 0, side * wide, -tall * 0.1), np.array([0.05, 0.02, 0.09]), GREY)
        for side in (-1, 1)
    ]
    for _ in range(int(rng.integers(0, 24))):  # curls, a beard, a wreath
        ray = rng.normal(0, 1, 3)
        ray /= np.linalg.norm(ray)
        if ray[0] > 0.5 and ray[2] > -0.3:
            continue
        spot = middle + ray * [deep, wide, tall] * 0.98
        shapes.append(ball(spot, rng.uniform(0.03, 0.09, 3), GREY, rotation(rng, 0.6)))
    if rng.random() < 0.5:
        chest = np.array([rng.uniform(0.15, 0.25), rng.uniform(0.3, 0.5), rng.uniform(0.15, 0.3)])
        shapes.append(ball(np.array([0, 0, base + 0.1]), chest, GREY))
    if base:
        shapes.append(drum(np.zeros(3), base, rng.uniform(0.12, 0.22), GREY))
    sockets = [
        ball(
            _off(middle, deep * 0.98, side * wide * 0.4, tall * 0.02),
            np.array([0.05, 0.06, 0.04]),
            GREY,
        )
        for side in (-1, 1)
    ]
    return shapes, sockets if rng.random() < 0.8 else []


def skull(rng: np.random.Generator) -> tuple[Shapes, Shapes]:
    """Build a skull or a mask: a vault with sockets, a snout and a row of teeth."""
    deep, wide, tall = rng.uniform(0.3, 0.5), rng.uniform(0.22, 0.32), rng.uniform(0.2, 0.3)
    middle = np.array([0, 0, tall + rng.uniform(0.05, 0.2)])
    snout = rng.uniform(0.1, 0.5)
    front = _off(middle, deep * 0.8 + snout / 2, 0, -tall * 0.5)
    shapes = [
        ball(middle, np.array([deep, wide, tall]), GREY),
        ball(front, np.array([0.15 + snout / 2, wide * 0.5, tall * 0.45]), GREY),
        ball(_off(front, 0, 0, -tall * 0.5), np.array([0.12 + snout / 2, wide * 0.45, 0.07]), GREY),
    ]
    for y in np.linspace(-0.35, 0.35, int(rng.integers(4, 9))) * wide:
        tooth = _off(front, 0.1 + snout / 2 - abs(y), y, -tall * 0.35)
        shapes.append(ball(tooth, np.array([0.02, 0.02, 0.05]), GREY))
    if rng.random() < 0.3:  # horns
        for side in (-1, 1):
            path = [_off(middle, 0, side * wide * 0.6, tall * 0.7)]
            for _ in range(4):
                path.append(
                    _off(path[-1], rng.normal(-0.05, 0.05), side * 0.12, rng.normal(0.08, 0.06))
                )
            shapes += limb(path, 0.07, 0.02, GREY)
    hollows = [
        ball(_off(middle, deep * 0.85, side * wide * 0.5, 0), rng.uniform(0.06, 0.11, 3), GREY)
        for side in (-1, 1)
    ]
    hollows.append(ball(_off(front, 0.14 + snout / 2, 0, 0.03), np.full(3, 0.06), GREY))
    return shapes, hollows


def boulder(rng: np.random.Generator) -> tuple[Shapes, Shapes]:
    """Build a stone, a root, a shell: a few big rounds, some cut off flat."""
    shapes = []
    for _ in range(int(rng.integers(1, 5))):
        radii = rng.uniform(0.15, 0.5, 3)
        spot = np.array([*rng.normal(0, 0.15, 2), radii[2] * rng.uniform(0.6, 1.2)])
        shapes.append(ball(spot, radii, GREY, rotation(rng, 0.8)))
    hollows = []
    for _ in range(int(rng.integers(0, 3))):
        ray = rng.normal(0, 1, 3)
        spot = np.array([0, 0, 0.35]) + 0.75 * ray / np.linalg.norm(ray)
        hollows.append(block(spot, rng.uniform(0.4, 0.8, 3).tolist(), GREY))
    return shapes, hollows


def tool(rng: np.random.Generator) -> tuple[Shapes, Shapes]:
    """Build a handle with a head: an axe, a hammer, a ladle, a sword; lying, leaning or upright."""
    long, thick = rng.uniform(0.7, 1.3), rng.uniform(0.025, 0.06)
    bend = rng.normal(0, 0.06, 3) * [1, 0, 1]
    path = [np.array([t * long, 0, 0]) + bend * np.sin(np.pi * t) for t in np.linspace(0, 1, 6)]
    shapes = limb(path, thick, thick * rng.uniform(0.7, 1.4), GREY)
    end, kind = path[-1], rng.random()
    if kind < 0.4:  # a blade across
        reach = rng.uniform(0.12, 0.35)
        for t in np.linspace(0, 1, 5):
            blade = [rng.uniform(0.05, 0.08) + 0.14 * t, 0.09 * (1.1 - t), 0.25 * reach]
            shapes.append(block(_off(end, 0, 0, t * reach), blade, GREY))
    elif kind < 0.7:
        size = rng.uniform([0.08, 0.08, 0.25], [0.16, 0.16, 0.5])
        shapes.append(block(end, size.tolist(), GREY))
    else:
        shapes.append(ball(end, rng.uniform([0.1, 0.03, 0.06], [0.4, 0.2, 0.12]), GREY))
    tilt = float(rng.choice([0.0, 0.0, rng.uniform(0.3, 1.2), np.pi / 2]))
    c, s = np.cos(tilt), np.sin(tilt)
    lift = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    if tilt == 0.0 and rng.random() < 0.7:  # on its side
        lift = np.array([[1, 0, 0], [0, 0, -1.0], [0, 1, 0]])
    middle = np.array([long / 2, 0, 0])
    return [Shape(p.kind, lift @ (p.centre - middle), lift @ p.axes, p.colour) for p in shapes], []


def branch(rng: np.random.Generator) -> tuple[Shapes, Shapes]:
    """Build a bone, a root, a coral: a thick path, at times with side arms."""
    shapes: Shapes = []
    thick = rng.uniform(0.04, 0.12)
    path = [np.array([-0.5, 0, thick])]
    lean = rng.uniform(0, 0.8)
    for _ in range(6):
        path.append(_off(path[-1], 0.17, rng.normal(0, 0.06), rng.normal(lean * 0.12, 0.03)))
    shapes += limb(path, thick, thick * rng.uniform(0.4, 1.1), GREY)
    for spot in (path[0], path[-1]):
        for _ in range(int(rng.integers(0, 3))):
            knob = spot + rng.normal(0, 0.6, 3) * thick
            shapes.append(ball(knob, thick * rng.uniform(0.8, 1.6, 3), GREY))
    for spot in path[1:-1]:
        if rng.random() < 0.4:
            arm = [spot]
            for _ in range(3):
                arm.append(
                    _off(arm[-1], rng.normal(0.05, 0.08), rng.normal(0, 0.12), rng.uniform(0, 0.14))
                )
            shapes += limb(arm, thick * 0.6, thick * 0.25, GREY)
    return shapes, []


def gown(rng: np.random.Generator) -> tuple[Shapes, Shapes]:
    """Build a garment, a bell, a draped bust: rings of folds that wander as they fall."""
    shapes: Shapes = []
    tall, levels = rng.uniform(0.8, 1.5), 9
    folds = int(rng.integers(5, 13))
    foot, waist, chest = rng.uniform(0.25, 0.6), rng.uniform(0.12, 0.25), rng.uniform(0.18, 0.35)
    radii = np.interp(
        np.linspace(0, 1, levels), [0, 0.6, 0.85, 1], [foot, waist, chest, waist * 0.6]
    )
    around = np.arange(folds) * 2 * np.pi / folds
    rims = []
    for level, radius in enumerate(radii):
        around = around + rng.normal(0, 0.08, folds)
        far = radius * (1 + rng.normal(0, 0.06, folds))
        z = np.full(folds, 0.03 + tall * level / (levels - 1))
        rims.append(np.stack([far * np.cos(around), far * np.sin(around), z], axis=1))
    for lower, upper in pairwise(rims):
        for a, b in zip(lower, upper, strict=True):
            shapes += limb([a, b], 0.06, 0.05, GREY)
    for rim, radius in zip(rims, radii, strict=True):
        shapes.append(
            drum(up(float(rim[0, 2]) - 0.06), 0.12 + tall / levels / 2, radius * 0.92, GREY)
        )
    return shapes, []


FAMILIES: tuple[Family, ...] = (
    head,
    head,
    skull,
    boulder,
    boulder,
    tool,
    tool,
    branch,
    gown,
    _painted(animal),
    _painted(person),
    _painted(person),
    _painted(bust),
    _painted(vase),
)
