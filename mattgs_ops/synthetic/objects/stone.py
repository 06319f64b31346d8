"""A weathered stone figure on a round foot: dull, speckled, of the colour of what lies around it.

The segmenter never trains on it. For evaluation sets only.
"""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.objects import figurine
from mattgs_ops.synthetic.surfaces.materials import Group, Material, Stage, pose
from mattgs_ops.synthetic.surfaces.mesh import Mesh, cylinder, rotation
from mattgs_ops.synthetic.surfaces.textures import granite
from mattgs_ops.synthetic.surroundings.desk import Layout

LAYOUT = Layout(clear=14, reach=28, tone=(150, 118, 84), keep=48)
ORBITS = (Orbit(24, 38, 20), Orbit(42, 38, 17), Orbit(60, 38, 11))
TARGET = np.array([0.0, 0.0, 7.5])
TILE = 20.0  # centimetres that the stone's image spans
IMAGE = 512


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the figure on the stage; ``rng`` paints the stone and dents it a little."""
    body, group = figurine.surface(rng), Group()
    skin = Material(granite(rng, IMAGE, IMAGE, (150, 140, 126)), 0.9)
    x, y, z = body.vertices.T
    uv = np.stack([x / TILE + 0.5 + 0.02 * y, z / TILE], axis=1)
    group.add(Mesh(body.vertices, body.normals, uv, body.faces), skin)
    group.add(cylinder(6.5, 1.5, 0.2, 40), skin)
    frame = pose(0, 0, ground, rotation(z=70))
    group.place(stage, frame, own=True)
    stage.corners.append(body.vertices[::200] @ frame[:3, :3].T + frame[:3, 3])
