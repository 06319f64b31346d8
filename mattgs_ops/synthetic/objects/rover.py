"""A six-wheeled rover: large parts, rocker-bogie legs, a drilled deck with electronics, a mast."""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.objects import parts
from mattgs_ops.synthetic.surfaces import print as sheets
from mattgs_ops.synthetic.surfaces import textures
from mattgs_ops.synthetic.surfaces.drilled_plate import drilled_plate
from mattgs_ops.synthetic.surfaces.materials import (
    ALUMINIUM,
    BLACK,
    DARK_STEEL,
    RUBBER,
    STEEL,
    WHITE,
    Group,
    Material,
    Stage,
    plain,
    pose,
    printed,
)
from mattgs_ops.synthetic.surfaces.mesh import Array, box, cylinder, lathe, quad, rotation
from mattgs_ops.synthetic.surroundings import clutter
from mattgs_ops.synthetic.surroundings.desk import Layout

LAYOUT = Layout(
    clear=16,
    reach=38,
    keep=58,
    tone=(186, 140, 92),
    under=((clutter.mat, 5, -3, 14.0),),
    low=30,
    small=20,
)
ORBITS = (Orbit(21, 52, 21), Orbit(40, 53, 17), Orbit(60, 55, 10))
TARGET = np.array([0.0, 0.0, 9.5])
WINDOW = 35.0
LIGHT = 1.0

RADIUS, TYRE = 3.3, 3.0  # of the wheels
TRACK = 9.2  # half the distance between left and right wheels
AXLES = (-10.5, 0.0, 10.5)
BODY = np.array([18.0, 11.0, 4.6])
FLOOR = 7.4  # height of the body's underside
ORANGE = plain("d2601a", 0.35)


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the rover on the stage, its wheels on ``ground``."""
    rover = Group()
    for side in (-1, 1):
        for x in AXLES:
            turn = rotation(z=float(rng.uniform(0, 60)))
            frame = pose(x, side * TRACK, RADIUS + 0.15) @ rotation(x=-90 * side) @ turn
            rover.absorb(wheel(), frame)
        rover.absorb(suspension(side), np.eye(4))
    corners = [body(rover, rng), mast(rover)]
    deck(rover, rng)
    frame = pose(0, 0, ground, rotation(z=18))
    rover.place(stage, frame, own=True)
    stage.corners += [points @ frame[:3, :3].T + frame[:3, 3] for points in corners]


def wheel() -> Group:
    """Return a wheel whose outer side looks up, centred at the origin."""
    group, half = Group(), TYRE / 2
    tyre = [(2.2, -half), (RADIUS - 0.25, -half), (RADIUS, -half + 0.3), (RADIUS, half - 0.3)]
    group.add(lathe([*tyre, (RADIUS - 0.25, half), (2.2, half), (2.2, -half)], 48), RUBBER)
    for k in range(22):
        for row, shift in ((-0.75, 0.0), (0.75, 0.5)):
            lug = box(0.42, 1.35, 0.34, 0.06).turned(x=90).turned(y=90)
            place = pose(RADIUS - 0.12, 0, row) @ rotation(x=18 if row > 0 else -18)
            group.add(lug.transformed(rotation(z=(k + shift) * 360 / 22) @ place), RUBBER)
    rim = [(0, -1.1), (2.2, -1.1), (2.2, 1.35), (2.05, 1.42), (1.9, 1.2), (1.75, 0.75), (0, 0.75)]
    group.add(lathe(rim, 40), plain("c7c9cc", 0.4))
    for k in range(6):
        spoke = box(1.25, 0.42, 0.35, 0.06).at(x=1.18, z=0.72).turned(z=60 * k)
        group.add(spoke, ORANGE)
        hole = cylinder(0.26, 0.02, 0.004, 18).at(x=1.3, z=0.752).turned(z=60 * k + 30)
        group.add(hole, plain("0d0d0e", 0.8))
        angle = np.radians(60 * k + 10)
        parts.screws(group, [(1.75 * np.cos(angle), 1.75 * np.sin(angle), 1.0)], 0.16, STEEL)
    group.add(cylinder(0.72, 0.75, 0.1).at(z=0.6), ALUMINIUM)
    parts.screws(group, [(0, 0, 1.35)], 0.32, DARK_STEEL)
    return group


def suspension(side: int) -> Group:
    """Return one side's rocker, bogie, motors and screws."""
    group, y = Group(), side * 6.6
    axle = [np.array([x, y, RADIUS + 0.15]) for x in AXLES]
    pivot, joint = np.array([2.0, y, 9.4]), np.array([-5.2, y, 6.6])
    knee = np.array([8.2, y, 8.0])
    for start, end in ((pivot, joint), (pivot, knee), (knee, axle[2])):
        group.absorb(parts.beam(start, end, 1.3, 0.7, ALUMINIUM), np.eye(4))
    for end in axle[:2]:
        group.absorb(parts.beam(joint, end, 1.15, 0.55, ORANGE), pose(0, side * 0.25, 0))
    for point, radius in ((pivot, 0.5), (joint, 0.42), (knee, 0.34)):
        disc = cylinder(radius * 2, 0.3, 0.06).turned(x=-90 * side)
        group.add(disc.at(point[0], point[1] + side * 0.35, point[2]), DARK_STEEL)
        spot = (float(point[0]), float(point[1]) + side * 0.66, float(point[2]))
        group.absorb(parts.side_screw(*spot, side, radius, STEEL), np.eye(4))
    for point in axle:
        motor = cylinder(1.15, 2.6, 0.12).turned(x=90 * side).at(point[0], y + side * 0.9, point[2])
        group.add(motor, plain("2d3036", 0.4, 0.4))
        body_end = np.array([point[0], y - side * 1.2, point[2] + 0.8])
        rise = [
            body_end.tolist(),
            [point[0] * 0.8, y - side * 1.6, 6.2],
            [point[0] * 0.5, side * 4.6, FLOOR + 0.3],
        ]
        for k, colour in enumerate(("b3261e", "17181a")):
            shifted = [[p[0] + 0.18 * k, p[1], p[2]] for p in rise]
            group.absorb(parts.wire(shifted, 0.085, colour), np.eye(4))
    return group


def body(rover: Group, rng: Generator) -> Array:
    """Add the chassis; return its vertices, [24, 3]."""
    shell = box(float(BODY[0]), float(BODY[1]), float(BODY[2]), 0.25).at(z=FLOOR)
    rover.add(shell, plain("dddad2", 0.4))
    top = FLOOR + float(BODY[2])
    rover.add(box(BODY[0] + 0.5, BODY[1] + 0.5, 0.3, 0.08).at(z=top), plain("33363c", 0.4))
    for side in (-1, 1):
        panel = textures.smudged(rng, 900, 210, (206, 92, 34))
        sheet = sheets.Sheet(900, 210, (206, 92, 34))
        sheet.paste(panel, 0, 0)
        sheet.text(30, 18, "PATHFINDER VI", 74, (246, 242, 232), "DejaVuSans-Bold")
        sheet.text(34, 110, "field unit 07 · 12 V 5 A", 40, (246, 242, 232), "DejaVuSans-Bold")
        sheet.text(34, 160, "CAUTION: keep clear of moving wheels", 26, (30, 26, 24))
        for k in range(7):
            left = 660 + 34 * k
            sheet.draw.polygon(
                [(left, 190), (left + 17, 190), (left + 47, 60), (left + 30, 60)], fill=(28, 26, 24)
            )
        face = quad(15.0, 3.5).turned(x=90).at(0, -BODY[1] / 2 - 0.02, FLOOR + 2.3)
        rover.add(face.turned(z=90 - 90 * side), printed(sheet.array(), (206, 92, 34), 0.4))
        for x in (-8.2, -4.1, 4.1, 8.2):
            for z in (FLOOR + 0.45, FLOOR + 4.15):
                y = side * (BODY[1] / 2 + 0.01)
                rover.absorb(parts.side_screw(x, y, z, side, 0.24, STEEL), np.eye(4))
    for end in (-1, 1):
        grill = drilled_plate(12, 4, 0.8, 0.27, 0.15).turned(x=90).turned(z=90 * end)
        rover.add(grill.at(end * (BODY[0] / 2 + 0.2), 0, FLOOR + 2.3), ALUMINIUM)
    for y in (-4.2, 4.2):
        lamp = lathe([(0.85, 0), (0.85, 0.5), (0.65, 0.55), (0.6, 0.3), (0, 0.3)], 24)
        rover.add(lamp.turned(y=90).at(BODY[0] / 2 + 0.3, y, FLOOR + 3.9), plain("e9e6d4", 0.15))
    return shell.vertices


def deck(rover: Group, rng: Generator) -> None:
    """Add what is on top: the drilled plate, battery, boards, aerial, wires."""
    top = FLOOR + float(BODY[2]) + 0.3
    plate = drilled_plate(17, 10, 1.0, 0.3, 0.2)
    for x in (-8, 8):
        for y in (-4.5, 4.5):
            rover.add(cylinder(0.35, 0.9, 0.04, 6).at(x, y, top), plain("c2a050", 0.32, 1.0))
            parts.screws(rover, [(x, y, top + 1.1)], 0.38, STEEL)
    deck_z = top + 0.9
    rover.add(plate.at(z=deck_z), ALUMINIUM)
    deck_z += 0.2
    _battery(rover, rng, deck_z)
    board = Group()
    board.add(box(6.6, 5.0, 0.16, 0.02), plain("14532f", 0.4))
    board.absorb(
        parts.board_print(rng, 6.5, 4.9, (22, 92, 52), "ROVER CTRL v2.1"), pose(0, 0, 0.16)
    )
    board.absorb(parts.chip(1.6, 1.3, ["RV-2040", "MCU 133"]), pose(-0.6, 0.1, 0.17))
    board.absorb(parts.chip(0.9, 0.5, ["DRV88"]), pose(1.7, -1.2, 0.17))
    board.absorb(parts.header(18, 2), pose(0, 2.05, 0.17))
    board.absorb(parts.header(10, 1), pose(-1, -2.15, 0.17))
    board.absorb(parts.capacitor(0.42, 1.0), pose(2.4, 0.5, 0.17))
    board.absorb(parts.capacitor(0.32, 0.8), pose(2.5, -0.6, 0.17))
    board.add(box(1.3, 1.2, 1.0, 0.05).at(-2.9, 0.6, 0.17), STEEL)
    parts.screws(board, [(x, y, 0.17) for x in (-3, 3) for y in (-2.2, 2.2)], 0.26, STEEL)
    rover.absorb(board, pose(-4.2, 1.4, deck_z + 0.4, rotation(z=4)))
    loops = (("b3261e", 0.0), ("17181a", 0.3), ("d9a520", 0.6), ("2a5fb0", 0.9), ("2f8f4e", 1.2))
    for colour, shift in loops:
        points = [[-2.4 + shift, -0.7, deck_z + 1.0], [-1.5 + shift, -1.5, deck_z + 2.2]]
        points += [[2 + shift, 0.2 + shift, deck_z + 2.0], [5.2, 1.6 + 0.3 * shift, deck_z + 0.2]]
        rover.absorb(parts.wire(points, 0.075, colour), np.eye(4))
    rover.add(cylinder(0.5, 0.8, 0.06, 20).at(-8, -2.2, deck_z), BLACK)
    rover.add(cylinder(0.12, 9.5, 0.05, 10).at(-8, -2.2, deck_z + 0.8), BLACK)
    rover.add(cylinder(0.22, 1.1, 0.1, 12).at(-8, -2.2, deck_z + 10), ORANGE)


def _battery(rover: Group, rng: Generator, z: float) -> None:
    pack = Group()
    pack.add(box(8.2, 3.2, 2.2, 0.3), plain("1f4fa0", 0.35))
    lines = ["LiPo 7.4 V", "2200 mAh  30C", f"SN {rng.integers(10**6, 10**7)}"]
    pack.absorb(parts.decal(lines, 7.2, 2.6, (236, 200, 60), (24, 24, 28)), pose(0, 0, 2.2))
    side = parts.decal(
        ["PATHFINDER POWER", "do not puncture"], 7.0, 1.6, (31, 79, 160), (240, 240, 235)
    )
    pack.absorb(side, pose(0, -1.61, 1.1, rotation(x=90)))
    for x in (-2.6, 2.6):
        pack.add(box(0.9, 3.3, 2.32, 0.1).at(x, 0, -0.02), plain("232427", 0.75))
    for k, colour in enumerate(("b3261e", "17181a")):
        y = -0.4 + 0.8 * k
        path = [[-4.1, y, 1.5], [-5.2, y, 2.0], [-6.4, y + 1.2, 1.4], [-6.6, y + 2.4, 0.7]]
        pack.absorb(parts.wire(path, 0.16, colour), np.eye(4))
    rover.absorb(pack, pose(2.8, -2.9, z))


def mast(rover: Group) -> Array:
    """Add the mast with its stereo head; return the head's vertices, [24, 3]."""
    x, y, base = 6.4, 2.4, FLOOR + float(BODY[2]) + 1.4
    rover.add(box(2.6, 2.6, 0.5, 0.08).at(x, y, base), DARK_STEEL)
    places = [(x + a, y + b, base + 0.5) for a in (-1, 1) for b in (-1, 1)]
    parts.screws(rover, places, 0.22, STEEL)
    rover.add(cylinder(0.62, 7.2, 0.05).at(x, y, base), ALUMINIUM)
    rover.add(cylinder(0.85, 0.8, 0.1).at(x, y, base + 3.2), ORANGE)
    rover.add(cylinder(1.0, 0.9, 0.12).at(x, y, base + 6.9), BLACK)
    head = box(2.6, 6.4, 2.9, 0.3).at(x + 0.2, y, base + 7.8)
    rover.add(head, WHITE)
    for shift in (-1.9, 1.9):
        lens = lathe([(1.05, 0), (1.05, 0.55), (0.9, 0.6), (0.8, 0.3), (0.5, 0.12), (0, 0.05)], 30)
        lens = lens.turned(y=90).at(x + 1.5, y + shift, base + 9.3)
        rover.add(lens, Material((14, 16, 24), 0.12))
        ring = lathe([(1.05, 0), (1.25, 0), (1.25, 0.3), (1.05, 0.35)], 30).turned(y=90)
        rover.add(ring.at(x + 1.5, y + shift, base + 9.3), DARK_STEEL)
    name = parts.decal(["STEREO CAM", "1080p 120°"], 2.2, 1.0, (232, 230, 224), (30, 30, 36), 90)
    rover.absorb(name, pose(x + 0.2, y + 1.8, base + 10.7, rotation(z=90)))
    back = parts.decal(["MASTCAM", "MODEL 3B"], 5.0, 1.8, (40, 42, 48), (238, 236, 230))
    rover.absorb(back, pose(x - 1.11, y, base + 9.3, rotation(x=90, z=-90)))
    places = [(x + 0.2 + a, y + b, base + 10.7) for a in (-1, 1) for b in (-2.9, 2.9)]
    parts.screws(rover, places, 0.2, STEEL)
    cord = [[x - 1.1, y - 2, base + 9], [x - 2.6, y - 1.6, base + 6.5]]
    cord += [[x - 1.2, y - 0.9, base + 3], [x - 2.4, y - 0.8, base + 0.6], [x - 4, y - 0.6, base]]
    rover.absorb(parts.wire(cord, 0.14, "17181a"), np.eye(4))
    return head.vertices
