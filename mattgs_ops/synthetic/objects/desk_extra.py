"""Other objects on another desk: a toy crane, a camera and a stack of blocks on a tray.

For tests and evaluation sets only: it shares no object with the three captures.
"""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.objects import parts
from mattgs_ops.synthetic.surfaces.materials import (
    ALUMINIUM,
    BLACK,
    STEEL,
    Group,
    Material,
    Stage,
    plain,
    pose,
)
from mattgs_ops.synthetic.surfaces.mesh import Array, box, cylinder, lathe, rotation
from mattgs_ops.synthetic.surroundings import clutter
from mattgs_ops.synthetic.surroundings.desk import Layout
from mattgs_ops.synthetic.surroundings.item import bright

LAYOUT = Layout(
    clear=14,
    reach=36,
    tone=(122, 92, 70),
    under=((clutter.cloth, 1, 2, 62.0),),
    sheets=12,
    keep=52,
)
ORBITS = (Orbit(24, 46, 20), Orbit(42, 46, 17), Orbit(60, 46, 11))
TARGET = np.array([0.0, 0.0, 6.0])
WINDOW = 100.0
LIGHT = 1.0


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the tray and what stands on it on the stage."""
    whole = Group()
    tray = box(22, 15, 0.8, 0.3)
    whole.add(tray, plain("3f5f73", 0.4))
    name = parts.decal(
        ["WORKSHOP SAMPLE 4", "please return"], 8, 1.6, (63, 95, 115), (240, 236, 226)
    )
    whole.absorb(name, pose(4.5, -6.2, 0.8))
    parts.screws(whole, [(x, y, 0.8) for x in (-10, 10) for y in (-6.5, 6.5)], 0.35, STEEL)
    camera = _camera(whole)
    _blocks(whole, rng)
    _crane(whole)
    frame = pose(0, 0, ground, rotation(z=33))
    whole.place(stage, frame, own=True)
    stage.corners += [p @ frame[:3, :3].T + frame[:3, 3] for p in (tray.vertices, camera)]


def _camera(whole: Group) -> Array:
    """Add a compact camera; return its case's vertices, [24, 3]."""
    case = box(9, 3.6, 5.8, 0.4).at(3.8, 2.6, 0.8)
    whole.add(case, plain("2a2622", 0.6))
    whole.add(box(8.8, 3.4, 1.2, 0.3).at(3.8, 2.6, 6.2), ALUMINIUM)
    rings = [(2.2, 0), (2.2, 1.2), (2.0, 1.3), (2.0, 2.2), (1.7, 2.3), (1.5, 1.8), (0, 1.5)]
    whole.add(lathe(rings, 40).turned(x=90).at(3.8, 0.8, 3.6), BLACK)
    whole.add(
        cylinder(1.45, 0.02, 0.004).turned(x=90).at(3.8, -0.75, 3.6), Material((20, 22, 40), 0.12)
    )
    whole.add(cylinder(0.6, 0.5, 0.1).at(6.6, 2.6, 7.4), STEEL)
    name = parts.decal(["OPTIKA 35"], 3.0, 0.7, (213, 215, 218), (25, 25, 28), 90)
    whole.absorb(name, pose(1.6, 0.885, 6.8, rotation(x=90)))
    return case.vertices


def _blocks(whole: Group, rng: Generator) -> None:
    """Add wooden blocks with letters."""
    for k, (x, y, z) in enumerate(
        ((-8, -3, 0), (-5.2, -3.4, 0), (-6.6, -3.1, 2.5), (-8.2, 0.2, 0))
    ):
        turn = rotation(z=float(rng.normal(0, 14)))
        block = Group()
        block.add(box(2.5, 2.5, 2.5, 0.2), bright(rng, 0.5))
        for side in range(4):
            face = parts.decal(["RTQK"[(k + side) % 4]], 1.9, 1.9, (232, 214, 176), (40, 50, 130))
            block.absorb(face, rotation(z=90 * side) @ pose(0, -1.255, 1.25, rotation(x=90)))
        block.absorb(
            parts.decal(["AMGS"[k]], 1.9, 1.9, (232, 214, 176), (150, 30, 30)), pose(0, 0, 2.5)
        )
        whole.absorb(block, pose(x, y, 0.8 + z, turn))


def _crane(whole: Group) -> None:
    """Add a lattice tower with a jib and its rope."""
    yellow = plain("d8a21c", 0.4)
    for x in (-1.1, 1.1):
        for y in (-1.1, 1.1):
            whole.add(box(0.3, 0.3, 13, 0.05).at(-5.5 + x, 4 + y, 0.8), yellow)
    for level in range(6):
        for turn in (0, 90, 180, 270):
            bar = box(2.9, 0.16, 0.22, 0.03).turned(y=-38).at(0, -1.1, 2 + 2.1 * level)
            whole.add(bar.turned(z=turn).at(-5.5, 4, 0), yellow)
    whole.add(box(3, 3, 1.6, 0.2).at(-5.5, 4, 13.8), plain("b1271f", 0.35))
    whole.add(box(13, 0.5, 0.5, 0.08).at(-1, 4, 15.4), yellow)
    whole.absorb(
        parts.wire([[4.8, 4, 15.5], [4.8, 4, 12], [4.8, 4.05, 9.4]], 0.06, "222222"), np.eye(4)
    )
    whole.add(box(0.9, 0.5, 0.9, 0.15).at(4.8, 4.05, 8.6), STEEL)
