"""A plaster figurine: one smooth pale body with a tail, thin legs and a staff, on a round foot.

It looks like none of the objects that the segmenter trains on. For evaluation sets only.
"""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.objects import parts
from mattgs_ops.synthetic.surfaces.materials import Group, Stage, plain, pose
from mattgs_ops.synthetic.surfaces.mesh import Mesh, cylinder, rotation, wind
from mattgs_ops.synthetic.surroundings.desk import Layout

LAYOUT = Layout(clear=14, reach=28, tone=(150, 118, 84), keep=48)
ORBITS = (Orbit(24, 37, 20), Orbit(42, 37, 17), Orbit(60, 37, 11))
TARGET = np.array([0.0, 0.0, 7.5])
WINDOW = 80.0
LIGHT = 1.0

CELLS = 72  # of the sampled field, along each side
HALF = 10.0  # centimetres the field reaches to each side; it stands on z = 0
LEVEL = 0.5  # of the field, where its surface is
# centre, radius, in centimetres: body, neck, head, muzzle, arms, haunches, tail
LUMPS = (
    ((0.0, 0.0, 6.4), 3.4),
    ((0.9, 0.0, 9.6), 2.4),
    ((2.0, 0.0, 12.2), 1.7),
    ((3.2, 0.1, 14.2), 2.0),
    ((5.2, 0.2, 13.8), 1.2),
    ((2.6, 2.6, 9.6), 1.1),
    ((4.0, 3.6, 9.2), 0.9),
    ((5.4, 4.0, 9.8), 0.8),
    ((2.8, -2.5, 9.0), 1.1),
    ((4.3, -2.7, 8.2), 0.9),
    ((0.4, 2.3, 4.0), 1.9),
    ((0.4, -2.3, 4.0), 1.9),
    ((1.0, 2.6, 1.6), 1.1),
    ((1.0, -2.6, 1.6), 1.1),
    ((-3.0, 0.0, 4.4), 1.9),
    ((-5.0, 0.5, 3.0), 1.3),
    ((-6.8, 1.3, 2.4), 0.9),
    ((-8.2, 2.4, 2.5), 0.7),
)


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the figurine on the stage; ``rng`` dents its surface a little."""
    group, plaster = Group(), plain("e6e3da", 0.75)
    body = surface(rng)
    group.add(body, plaster)
    group.add(cylinder(7.2, 1.2, 0.25, 48), plaster)
    group.absorb(
        parts.wire([[5.6, 4.3, 1.0], [5.5, 4.1, 9.8], [5.2, 3.7, 18.5]], 0.22, "d8d4c8"), np.eye(4)
    )
    for angle in (100, 140, 180, 220, 260):
        x, y = 6.2 * np.cos(np.radians(angle)), 6.2 * np.sin(np.radians(angle))
        group.add(cylinder(0.32, 3.4, 0.05, 12).at(float(x), float(y), 1.2), plaster)
    frame = pose(0, 0, ground, rotation(z=25))
    group.place(stage, frame, own=True)
    stage.corners.append(body.vertices[::200] @ frame[:3, :3].T + frame[:3, 3])


def surface(rng: Generator) -> Mesh:
    """Return the smooth body, where the sum of the lumps' bells is ``LEVEL``."""
    axis = np.linspace(-HALF, HALF, CELLS)
    x, y, z = np.meshgrid(axis, axis, axis + HALF - 0.2, indexing="ij")
    field: NDArray[np.float64] = np.zeros_like(x)
    for (cx, cy, cz), radius in LUMPS:
        away = (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2
        field += np.exp(-away / radius**2 * np.log(1 / LEVEL))
    phase = rng.uniform(0, 2 * np.pi, 3)
    field += 0.03 * np.sin(2.1 * x + phase[0]) * np.sin(2.3 * y + phase[1]) * np.sin(1.9 * z)
    step = 2 * HALF / (CELLS - 1)
    points, faces, normals, _ = marching_cubes(field, LEVEL, spacing=(step, step, step))
    placed = points.astype(np.float64) - np.array([HALF, HALF, 0.2])
    outward = normals.astype(np.float64)
    wound = wind(placed, outward, faces.astype(np.int64))
    return Mesh(placed, outward, np.zeros((len(placed), 2)), wound)
