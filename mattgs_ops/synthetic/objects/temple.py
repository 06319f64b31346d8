"""A plaster temple: pale, thin columns around an altar, on two steps.

The segmenter trains on painted temples, never on this one. For evaluation sets only.
"""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.surfaces.materials import Group, Stage, plain, pose
from mattgs_ops.synthetic.surfaces.mesh import box, cylinder, prism, rotation
from mattgs_ops.synthetic.surroundings.desk import Layout

LAYOUT = Layout(clear=14, reach=28, tone=(150, 118, 84), keep=48)
ORBITS = (Orbit(24, 34, 20), Orbit(42, 34, 17), Orbit(60, 34, 11))
TARGET = np.array([0.0, 0.0, 6.0])

ALONG, ACROSS = (-6.2, -3.1, 0.0, 3.1, 6.2), (-3.4, 3.4)  # where columns stand, centimetres
COLUMN_RADIUS, COLUMN_HEIGHT = 0.55, 7.5


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the temple on the stage, turned by what ``rng`` says."""
    group, plaster = Group(), plain("dedad0", 0.8)
    group.add(box(16, 10, 1.0, 0.1), plaster)
    group.add(box(14.6, 8.6, 0.8, 0.1).at(z=1.0), plaster)
    for x in ALONG:
        for y in ACROSS:
            group.add(cylinder(COLUMN_RADIUS, COLUMN_HEIGHT, 0.05, 24).at(x, y, 1.8), plaster)
    group.add(cylinder(1.0, 2.2, 0.1, 24).at(z=1.8), plaster)
    group.add(box(15, 9, 1.2, 0.1).at(z=9.3), plaster)
    roof = prism([(-7.5, 0), (7.5, 0), (0, 2.6)], 9, 0.05).turned(x=90).at(0, 4.5, 10.5)
    group.add(roof, plaster)
    frame = pose(0, 0, ground, rotation(z=float(rng.uniform(0, 90))))
    group.place(stage, frame, own=True)
    stage.corners.append(roof.vertices @ frame[:3, :3].T + frame[:3, 3])
