"""A six-legged walker: eighteen printed servos, jointed legs, drilled plates, thin wires."""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.objects import parts
from mattgs_ops.synthetic.surfaces.drilled_plate import drilled_plate
from mattgs_ops.synthetic.surfaces.materials import (
    ALUMINIUM,
    BLACK,
    DARK_STEEL,
    RUBBER,
    STEEL,
    Group,
    Stage,
    plain,
    pose,
)
from mattgs_ops.synthetic.surfaces.mesh import (
    Array,
    Mesh,
    ball,
    box,
    cylinder,
    lathe,
    prism,
    rotation,
)
from mattgs_ops.synthetic.surroundings import clutter
from mattgs_ops.synthetic.surroundings.desk import Layout

LAYOUT = Layout(
    clear=17,
    reach=40,
    keep=58,
    tone=(150, 100, 66),
    under=((clutter.newspaper, 2, 1, 31.0),),
    low=30,
)
ORBITS = (Orbit(25, 52, 20), Orbit(43, 52.5, 17), Orbit(62, 52.5, 11))
TARGET = np.array([0.0, 0.0, 5.0])
WINDOW = 150.0
LIGHT = 1.0

HEIGHT = 8.2  # of the hips over the ground
HIPS = ((5.6, 4.0, 38.0), (0.0, 5.2, 90.0), (-5.6, 4.0, 142.0))  # x, y, heading of the left ones
SERVO = 0.7  # size of these servos against a standard one
KNEE, FOOT = np.array([8.0, 0.0, 2.9]), np.array([10.3, 0.0, -HEIGHT + 0.5])
HIP_JOINT = np.array([3.5, 0.0, 0.0])
RED = plain("b1271f", 0.3)
WIRES = ("5f3b22", "b3261e", "d98e1f")


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the hexapod on the stage, its feet on ``ground``."""
    walker = Group()
    for side in (1, -1):
        for x, y, heading in HIPS:
            turn = side * (heading + float(rng.normal(0, 7)))
            lift = float(rng.uniform(0, 0.05))
            walker.absorb(leg(rng), pose(x, side * y, HEIGHT + lift, rotation(z=turn)))
    corners = body(walker, rng)
    frame = pose(0, 0, ground, rotation(z=-24))
    walker.place(stage, frame, own=True)
    stage.corners += [points @ frame[:3, :3].T + frame[:3, 3] for points in corners]


def leg(rng: Generator) -> Group:
    """Return a leg along +x, its hip's axis at the origin."""
    group, scale = Group(), np.diag([SERVO, SERVO, SERVO, 1.0])
    motor = parts.servo("MG-996")
    group.absorb(motor, pose(-0.7, 0, -1.5) @ scale)
    for z in (1.28, -1.75):
        group.add(box(3.4, 1.7, 0.16, 0.04).at(1.35, 0, z), ALUMINIUM)
        parts.screws(
            group, [(x, y, z + 0.16) for x in (0.4, 2.5) for y in (-0.5, 0.5)], 0.15, STEEL
        )
    group.add(box(0.18, 1.7, 3.1, 0.04).at(2.95, 0, -1.7), ALUMINIUM)
    lying = rotation(x=90)
    group.absorb(motor, pose(HIP_JOINT[0] + 0.4, 1.25, -0.2, lying) @ scale)
    group.absorb(motor, pose(KNEE[0] - 0.1, 1.25, KNEE[2] + 0.3, lying @ rotation(y=-62)) @ scale)
    for side in (-1, 1):
        y = side * 1.42
        shift = np.array([0, y, 0.0])
        group.absorb(parts.beam(HIP_JOINT + shift, KNEE + shift, 1.5, 0.18, RED), np.eye(4))
        along = (KNEE - HIP_JOINT) / np.linalg.norm(KNEE - HIP_JOINT)
        for t in (-0.45, 0.45, 4.9, 5.8):
            spot = HIP_JOINT + along * t
            head = parts.side_screw(
                float(spot[0]), y + side * 0.1, float(spot[2]), side, 0.2, STEEL
            )
            group.absorb(head, np.eye(4))
        for t in (1.9, 2.7, 3.5):
            spot = HIP_JOINT + along * t
            hole = cylinder(0.27, 0.012, 0.003, 18).turned(x=-90 * side)
            group.add(
                hole.at(float(spot[0]), y + side * 0.095, float(spot[2])), plain("0e0e10", 0.8)
            )
        group.add(_shin().turned(x=90).at(0, side * 0.85 + 0.08, 0), BLACK)
        for t in (0.06, 0.3, 0.55):
            spot = KNEE + (FOOT - KNEE) * t
            head = parts.side_screw(float(spot[0]), side * 0.95, float(spot[2]), side, 0.17, STEEL)
            group.absorb(head, np.eye(4))
    for t in (0.45, 0.75):
        spot = KNEE + (FOOT - KNEE) * t
        spacer = cylinder(0.22, 1.6, 0.03, 14).turned(x=90)
        group.add(spacer.at(float(spot[0]), 0.8, float(spot[2])), plain("c2a050", 0.32, 1.0))
    group.add(cylinder(0.55, 1.3, 0.1, 20).at(FOOT[0], 0, FOOT[2] + 0.1), DARK_STEEL)
    group.add(ball(0.62).at(FOOT[0], 0, FOOT[2] + 0.1), RUBBER)
    _leg_wires(group, rng)
    return group


def _shin() -> Mesh:
    """Return one plate of the shin in the plane x–z, seen as x–y, 0.16 thick."""
    down = (FOOT - KNEE) / np.linalg.norm(FOOT - KNEE)
    across = np.array([-down[2], 0, down[0]])
    marks = ((-1.0, 0.75), (0.5, 1.05), (3.2, 0.8), (8.5, 0.42), (10.9, 0.36))
    near = [KNEE + down * t + across * w for t, w in marks]
    far = [KNEE + down * t - across * w for t, w in reversed(marks)]
    return prism([(float(p[0]), float(p[2])) for p in [*near, *far]], 0.16, 0.03)


def _leg_wires(group: Group, rng: Generator) -> None:
    sag, away = float(rng.uniform(0.2, 0.7)), float(rng.uniform(-0.3, 0.3))
    for k, colour in enumerate(WIRES):
        o = 0.12 * k
        knee = [[KNEE[0] - 0.6, 1.0 + o, KNEE[2] + 1.1], [6.6, 1.9 + o, 3.2 + sag]]
        knee += [[4.2, 2.0 + o, 2.0 + sag], [1.4, 1.2 + away + o, 2.3], [-1.0, 0.4 + o, 2.6]]
        group.absorb(parts.wire([*knee, [-3.0, 0.2 + o, 3.4]], 0.055, colour), np.eye(4))
        hip = [[4.6, -1.2 - o, -0.6], [3.6, -2.0 - o, 0.6 + sag], [1.6, -1.7 - o, 1.9]]
        hip += [[-0.6, -0.9 - o, 2.4], [-2.6, -0.4 - o, 3.3]]
        group.absorb(parts.wire(hip, 0.055, colour), np.eye(4))


def body(walker: Group, rng: Generator) -> list[Array]:
    """Add the body's plates and what they carry; return vertices of boxes on it."""
    outline = [(7.4, 2.0), (5.2, 5.2), (-5.2, 5.2), (-7.4, 2.0), (-7.4, -2.0), (-5.2, -5.2)]
    outline = [*outline, (5.2, -5.2), (7.4, -2.0)]
    low, high = HEIGHT - 2.1, HEIGHT + 1.5
    black = plain("202226", 0.25)
    walker.add(prism(outline, 0.3, 0.06).at(z=low), black)
    walker.add(prism(outline, 0.3, 0.06).at(z=high), black)
    for x in (-6.2, -2.6, 2.6, 6.2):
        for y in (-4.2, 4.2) if abs(x) < 5 else (-1.6, 1.6):
            walker.add(cylinder(0.3, high - low - 0.3, 0.03, 6).at(x, y, low + 0.3), ALUMINIUM)
            parts.screws(walker, [(x, y, high + 0.3)], 0.3, STEEL)
    pack = box(7.0, 3.4, 1.9, 0.25).at(z=low + 0.35)
    walker.add(pack, plain("2c2f36", 0.5))
    for turn in (0, 180):
        tag = parts.decal(
            ["7.4V 5200mAh", "HEXA POWER 35C"], 6.2, 1.4, (226, 190, 40), (20, 20, 22)
        )
        walker.absorb(tag, rotation(z=turn) @ pose(0, -1.71, low + 1.3, rotation(x=90)))
    top = high + 0.3
    walker.add(drilled_plate(13, 7, 0.8, 0.22, 0.12).at(z=top + 0.7), ALUMINIUM)
    for x, y in ((-4.6, -2.2), (-4.6, 2.2), (4.6, -2.2), (4.6, 2.2)):
        walker.add(cylinder(0.26, 0.7, 0.03, 6).at(x, y, top), plain("c2a050", 0.32, 1.0))
        parts.screws(walker, [(x, y, top + 0.82)], 0.26, STEEL)
    board = _controller(rng)
    place = pose(-0.9, 0, top + 1.15, rotation(z=3))
    walker.absorb(board, place)
    _eyes(walker, top)
    name = parts.decal(["HEXA-18"], 3.4, 0.9, (32, 34, 38), (236, 232, 220), 90)
    for y, turn in ((-4.35, 0), (4.35, 180)):
        walker.absorb(name, pose(0, y, top, rotation(z=turn)))
    carried = board.items[0][0].transformed(place)
    return [pack.vertices, carried.vertices]


def _controller(rng: Generator) -> Group:
    board = Group()
    board.add(box(7.6, 5.0, 0.16, 0.02), plain("163a72", 0.4))
    face = parts.board_print(rng, 7.5, 4.9, (24, 62, 120), "SERVO CTRL 32")
    board.absorb(face, pose(0, 0, 0.16))
    board.absorb(parts.chip(1.3, 1.3, ["STM32", "F103"]), pose(0.2, 0.2, 0.17))
    board.absorb(parts.chip(0.8, 0.5, ["MP1584"]), pose(-2.3, 0.6, 0.17))
    for y in (-2.0, 2.0):
        board.absorb(parts.header(18, 3, 0.254, 0.9), pose(0.4, y, 0.17))
    board.absorb(parts.capacitor(0.45, 1.1), pose(-2.6, -0.7, 0.17))
    board.absorb(parts.capacitor(0.32, 0.8), pose(2.4, 0.4, 0.17))
    board.add(box(0.8, 0.9, 0.35, 0.05).at(-3.5, 1.4, 0.17), STEEL)
    terminal = box(1.0, 1.5, 1.0, 0.06).at(-3.2, -1.6, 0.17)
    board.add(terminal, plain("1f7a45", 0.4))
    parts.screws(board, [(-3.2, y, 1.17) for y in (-2.0, -1.2)], 0.22, DARK_STEEL)
    parts.screws(board, [(x, y, 0.17) for x in (-3.5, 3.5) for y in (-2.2, 2.2)], 0.22, STEEL)
    for k in range(16):
        x, side = float(rng.uniform(-1.8, 2.6)), 1 if k % 2 else -1
        colour = (*WIRES, "2a5fb0", "e2e0da")[k % 5]
        end = [float(rng.uniform(-4.5, 4.5)), side * 4.4, -0.9]
        path = [[x, side * 2.0, 0.9], [x, side * 2.3, 1.5 + 0.4 * rng.random()]]
        path += [[(x + end[0]) / 2, side * 3.4, 1.0], end]
        board.absorb(parts.wire(path, 0.055, colour), np.eye(4))
    return board


def _eyes(walker: Group, top: float) -> None:
    walker.add(box(0.18, 4.6, 2.1, 0.03).at(6.5, 0, top + 0.1), plain("1d4f9c", 0.4))
    tag = parts.decal(["HC-SR04", "T      R"], 1.2, 0.9, (29, 79, 156), (240, 240, 240), 120)
    walker.absorb(tag, pose(6.6, 0, top + 1.2, rotation(x=90, z=90)))
    for y in (-1.35, 1.35):
        eye = lathe([(0.82, 0), (0.82, 1.1), (0.72, 1.15), (0.68, 0.95), (0, 0.9)], 30)
        walker.add(eye.turned(y=90).at(6.6, y, top + 1.15), ALUMINIUM)
        walker.add(
            cylinder(0.66, 0.02, 0.004).turned(y=90).at(7.5, y, top + 1.15), plain("303236", 0.7)
        )
    for k, colour in enumerate(("b3261e", "17181a", "d98e1f", "2f8f4e")):
        y = -0.3 + 0.2 * k
        path = [
            [6.4, y, top + 0.4],
            [5.6, y, top + 1.6],
            [4.2, y * 2, top + 2.4],
            [2.6, y * 3, top + 1.5],
        ]
        walker.absorb(parts.wire(path, 0.055, colour), np.eye(4))
