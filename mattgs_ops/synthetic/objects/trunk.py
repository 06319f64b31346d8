"""A tree trunk with roots and stubs of branches: it leaves the frame at its top.

It looks like nothing that the segmenter trains on. For evaluation sets only.
"""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.surfaces.materials import Group, Material, Stage, pose
from mattgs_ops.synthetic.surfaces.mesh import Array, Mesh, ball, curve, lathe, tube
from mattgs_ops.synthetic.surfaces.textures import bark
from mattgs_ops.synthetic.surroundings.desk import Layout

LAYOUT = Layout(clear=24, reach=50, tone=(150, 118, 84), keep=80)
ORBITS = (Orbit(24, 62, 20), Orbit(42, 62, 17), Orbit(60, 62, 11))
TARGET = np.array([0.0, 0.0, 27.0])

PROFILE = ((22, 0), (17, 3), (14, 10), (12.5, 25), (11.5, 45), (11, 70))  # radius, height
ROOTS = 5  # ridges at the foot
STUBS = 3
STUB_LENGTH, STUB_RISE, STUB_RADIUS = 12.0, 9.0, 1.0
IMAGE = 1024


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the trunk on the stage; ``rng`` paints its bark and places the stubs."""
    group, skin = Group(), Material(bark(rng, IMAGE, IMAGE), 0.9)
    body = _body()
    group.add(body, skin)
    for _ in range(STUBS):
        around, height = rng.uniform(0, 2 * np.pi), rng.uniform(22, 40)
        out = np.array([np.cos(around), np.sin(around), 0.0])
        start = 11 * out + [0, 0, height]
        end = start + STUB_LENGTH * out + [0, 0, STUB_RISE]
        path = curve([list(start), list((start + end) / 2 + [0, 0, 1]), list(end)])
        group.add(tube(path, STUB_RADIUS), skin)
        group.add(ball(STUB_RADIUS).at(*end), skin)
    frame = pose(0, 0, ground)
    group.place(stage, frame, own=True)
    stage.corners.append(body.vertices @ frame[:3, :3].T + frame[:3, 3])


def _body() -> Mesh:
    """Return the trunk with ridges in its bark and roots at its foot."""
    mesh = lathe(PROFILE, 64, smooth=True)
    points: Array = mesh.vertices.copy()
    around = np.arctan2(points[:, 1], points[:, 0])
    foot = np.clip(1 - points[:, 2] / 10, 0, 1)
    radius, slope = np.ones(len(points)), np.zeros(len(points))
    for height, count, phase in (
        (0.06, ROOTS, 0.03 * points[:, 2]),
        (0.05, 11, 1.0),
        (0.18 * foot, ROOTS, 0.0),
    ):
        radius += height * np.sin(count * around + phase)
        slope += height * count * np.cos(count * around + phase)
    points[:, :2] *= radius[:, None]
    # a radius that grows with the angle tilts the normal against it
    out = np.stack([np.cos(around), np.sin(around)], axis=1)
    along = np.stack([-np.sin(around), np.cos(around)], axis=1)
    normals = mesh.normals.copy()
    tilt = (normals[:, :2] * out).sum(axis=1) * slope / radius
    normals[:, :2] -= tilt[:, None] * along
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mirrored = np.stack([np.abs(2 * mesh.uvs[:, 0] - 1), mesh.uvs[:, 1]], axis=1)  # no seam
    return Mesh(points, normals, mirrored, mesh.faces)
