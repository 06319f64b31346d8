"""The floor of a wood: fallen leaves, other trunks further away, undergrowth behind them."""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.surfaces import textures
from mattgs_ops.synthetic.surfaces.materials import Material, Stage
from mattgs_ops.synthetic.surfaces.mesh import cylinder, quad

FLOOR_SIZE, FLOOR_IMAGE = 500.0, 2048  # centimetres, pixels
LEAVES = 9000
EDGE = 235.0  # distance of the undergrowth
TRUNKS, NEAREST, FARTHEST = 26, 95.0, 220.0


def woods(rng: Generator) -> Stage:
    """Return floor, trunks and undergrowth, none of them the object's."""
    stage = Stage()
    floor = textures.fallen_leaves(rng, FLOOR_IMAGE, FLOOR_IMAGE, LEAVES)
    stage.add(quad(FLOOR_SIZE, FLOOR_SIZE), Material(floor, 0.95), own=False)
    green = Material(textures.foliage(rng, 1024, 512), 0.95)
    for turn in range(0, 360, 45):
        face = quad(EDGE, 220).turned(x=90).at(y=EDGE, z=90).turned(z=turn)
        stage.add(face, green, own=False)
    skin = Material(textures.bark(rng, 256, 256), 0.95)
    for _ in range(TRUNKS):
        around, far = rng.uniform(0, 2 * np.pi), rng.uniform(NEAREST, FARTHEST)
        tree = cylinder(float(rng.uniform(4, 12)), 200, 0.1, 16)
        stage.add(tree.at(far * np.cos(around), far * np.sin(around)), skin, own=False)
    return stage
