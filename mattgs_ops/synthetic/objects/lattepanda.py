"""A single-board computer on standoffs: ports, pin headers, printed chips, traces, a heat sink."""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.cameras import Orbit
from mattgs_ops.synthetic.objects import parts
from mattgs_ops.synthetic.surfaces import print as sheets
from mattgs_ops.synthetic.surfaces.materials import (
    ALUMINIUM,
    BLACK,
    GOLD,
    STEEL,
    Group,
    Image,
    Part,
    Stage,
    plain,
    pose,
    printed,
)
from mattgs_ops.synthetic.surfaces.mesh import Array, box, cylinder, lathe, quad, rotation
from mattgs_ops.synthetic.surroundings import clutter
from mattgs_ops.synthetic.surroundings.desk import Layout

LAYOUT = Layout(
    clear=7.2,
    reach=14.5,
    keep=20.5,
    tone=(206, 172, 126),
    under=((clutter.newspaper, 4, -6, 24.0),),
    sheets=16,
    small=34,
    low=34,
    tall=16,
    slope=0.32,
)
ORBITS = (Orbit(27, 17.8, 20), Orbit(44, 17.6, 17), Orbit(63, 17.4, 11))
TARGET = np.array([0.0, 0.0, 1.3])
WINDOW = 250.0
LIGHT = 0.75

WIDTH, DEPTH, LIFT = 8.8, 7.0, 1.0  # of the board, and its height over the desk
BASE = (19, 34, 66)  # solder mask
SILK = (228, 232, 236)
COPPER = (30, 56, 98)
DENSITY = 120  # pixels per centimetre of the board's print


def build(stage: Stage, rng: Generator, ground: float) -> None:
    """Put the board on the stage, its standoffs on ``ground``."""
    whole, board = Group(), Group()
    plate = box(WIDTH, DEPTH, 0.16, 0.02).at(z=-0.16)
    board.add(plate, plain("1a2a4c", 0.35))
    board.add(quad(WIDTH - 0.06, DEPTH - 0.06).at(z=0.006), printed(_face(rng), BASE, 0.3))
    _mounts(board)
    _ports(board)
    corners = [plate.vertices, _heat_sink(board)]
    _chips(board, rng)
    _headers(board)
    _passives(board, rng)
    _cables(board)
    frame = pose(0, 0, ground + LIFT + 0.16, rotation(z=-11))
    whole.absorb(board, np.eye(4))
    whole.place(stage, frame, own=True)
    stage.corners += [points @ frame[:3, :3].T + frame[:3, 3] for points in corners]


def _face(rng: Generator) -> Image:
    """Draw the board's upper face: traces, vias, pads, outlines, designators, the name."""
    sheet = sheets.Sheet(int(WIDTH * DENSITY), int(DEPTH * DENSITY), BASE)
    w, h = sheet.width, sheet.height
    for _ in range(46):  # buses of parallel traces, bending by 45°
        x, y = rng.uniform(0, w), rng.uniform(0, h)
        a, b = rng.uniform(-260, 260, 2)
        for k in range(int(rng.integers(2, 8))):
            o = 9 * k
            path = [(x + o, y), (x + o, y + a), (x + o + b, y + a + abs(b)), (x + o + b, y + 2 * a)]
            sheet.draw.line(path, fill=COPPER, width=3)
    for _ in range(260):
        x, y, r = rng.uniform(0, w), rng.uniform(0, h), rng.uniform(2.5, 4.5)
        sheet.draw.ellipse((x - r, y - r, x + r, y + r), fill=(168, 140, 84))
    for k in range(90):
        x, y = rng.uniform(20, w - 60), rng.uniform(20, h - 30)
        sheet.text(x, y, f"{'RCLUDQ'[k % 6]}{rng.integers(1, 240)}", 15, SILK)
        if k % 3 == 0:
            sheet.draw.rectangle((x - 4, y + 20, x + 34, y + 42), outline=SILK, width=2)
    sheet.draw.rectangle((w * 0.03, h * 0.84, w * 0.36, h * 0.95), fill=BASE)
    sheet.text(w * 0.04, h * 0.845, "LattePanda", 58, SILK, "DejaVuSans-Bold")
    sheet.text(w * 0.04, h * 0.915, "4G/64GB   V1.2   x86 + Arduino", 19, SILK)
    for k in range(14):
        sheet.text(w * 0.985 - 40, h * (0.2 + 0.045 * k), f"D{k}", 15, SILK)
        sheet.text(w * 0.02, h * (0.16 + 0.045 * k), f"A{k}", 15, SILK)
    return sheet.array()


def _mounts(board: Group) -> None:
    for x in (-4.05, 4.05):
        for y in (-3.15, 3.15):
            board.add(
                cylinder(0.3, LIFT, 0.04, 6).at(x, y, -LIFT - 0.16), plain("c2a050", 0.32, 1.0)
            )
            board.add(cylinder(0.36, 0.02, 0.004, 24).at(x, y, 0.006), GOLD)
            parts.screws(board, [(x, y, 0.02)], 0.27, STEEL)


def _ports(board: Group) -> None:
    steel, dark = plain("c4c6ca", 0.3, 1.0), plain("101012", 0.6)
    places = (("usb3", -2.7), ("usb2", -1.0), ("lan", 1.0), ("hdmi", 2.9))
    sizes = {
        "usb3": (1.45, 1.5, 1.55),
        "usb2": (1.45, 1.5, 1.55),
        "lan": (1.6, 2.1, 1.35),
        "hdmi": (1.5, 1.15, 0.62),
    }
    for name, x in places:
        w, d, h = sizes[name]
        y = DEPTH / 2 - d / 2 + 0.15
        board.add(box(w, d, h, 0.05).at(x, y, 0.01), steel)
        front = y + d / 2 + 0.006
        if name.startswith("usb"):
            tongue = plain("1d5fc4", 0.4) if name == "usb3" else plain("e8e6e0", 0.4)
            for z in (0.42, 1.12):
                board.add(box(1.2, 0.02, 0.5, 0.004).at(x, front, z - 0.25), dark)
                board.add(box(1.05, 0.03, 0.17, 0.004).at(x, front, z - 0.02), tongue)
        elif name == "lan":
            board.add(box(1.15, 0.02, 0.85, 0.004).at(x, front, 0.2), dark)
            for side, colour in ((-1, "35b34a"), (1, "e0a02c")):
                board.add(
                    box(0.18, 0.03, 0.14, 0.004).at(x + 0.62 * side, front, 1.12),
                    plain(colour, 0.2),
                )
        else:
            board.add(box(1.3, 0.02, 0.4, 0.004).at(x, front, 0.1), dark)
        tag = {"usb3": "USB 3.0", "usb2": "USB 2.0", "lan": "GbE", "hdmi": "HDMI"}[name]
        label = parts.decal([tag], w * 0.8, 0.4, (198, 200, 204), (40, 42, 48), 150)
        board.absorb(label, pose(x, y, h + 0.012))
        for side in (-1, 1):  # springs stamped into the shield
            board.add(box(0.16, 0.4, 0.03, 0.01).at(x + side * w * 0.3, y + d * 0.26, h), dark)
    board.add(box(0.95, 0.75, 0.35, 0.12).at(-4.15, -1.9, 0.01), steel)
    board.add(box(0.02, 0.55, 0.18, 0.005).at(-4.63, -1.9, 0.09), dark)
    jack = cylinder(0.33, 1.2, 0.04, 24).turned(y=-90).at(-3.4, 2.2, 0.35)
    board.add(jack, BLACK)
    board.add(cylinder(0.2, 0.02, 0.004, 20).turned(y=-90).at(-4.6, 2.2, 0.35), GOLD)
    for x in (2.1, 3.0):
        board.add(box(0.6, 0.6, 0.3, 0.03).at(x, -3.0, 0.01), steel)
        board.add(cylinder(0.16, 0.18, 0.03, 16).at(x, -3.0, 0.31), BLACK)


def _heat_sink(board: Group) -> Array:
    """Add the heat sink with its fins; return its base's vertices, [24, 3]."""
    x, y, size = -0.9, 0.25, 2.9
    board.add(box(1.9, 1.9, 0.16, 0.02).at(x, y, 0.01), plain("22242a", 0.4))
    base = box(size, size, 0.24, 0.03).at(x, y, 0.18)
    board.add(base, ALUMINIUM)
    for k in range(11):
        shift = (k - 5) * size / 11.4
        if k != 5:
            board.add(box(0.075, size, 0.85, 0.01).at(x + shift, y, 0.4), ALUMINIUM)
    tag = parts.decal(["CHERRY TRAIL", "x5-Z8350"], 2.2, 0.5, (206, 208, 210), (36, 38, 44), 150)
    board.absorb(tag, pose(x, y, 1.255))
    board.add(box(2.3, 0.55, 0.012, 0.002).at(x, y, 1.25), plain("cfd1d3", 0.4))
    for sx in (-1, 1):
        spot = (x + sx * (size / 2 - 0.05), y - sx * (size / 2 - 0.05), 0.42)
        board.add(cylinder(0.1, 0.3, 0.02, 12).at(spot[0], spot[1], 0.3), STEEL)
        parts.screws(board, [(spot[0], spot[1], 0.6)], 0.17, STEEL)
    return base.vertices


def _chips(board: Group, rng: Generator) -> None:
    stamp = f"{rng.integers(1000, 9999)}"
    for x, y, w, d, lines, turn in (
        (1.75, 1.0, 1.3, 1.0, ["KINGSTON", "EMMC64G", stamp], 0),
        (1.8, -0.35, 1.2, 0.9, ["SK hynix", "H5TC4G63"], 0),
        (2.3, -1.7, 1.0, 1.0, ["ATMEGA", "32U4-AU", stamp], 90),
        (0.6, -2.1, 0.8, 0.5, ["AXP288"], 0),
        (-2.95, -0.6, 0.7, 0.7, ["RTL8111"], 0),
        (-1.5, -2.15, 0.7, 0.45, ["W25Q64"], 0),
    ):
        board.absorb(parts.chip(w, d, lines, 0.13), pose(x, y, 0.006, rotation(z=turn)))
    can = box(1.5, 1.2, 0.22, 0.05).at(3.35, 1.2, 0.01)
    board.add(can, STEEL)
    tag = parts.decal(["WiFi/BT", "AP6330"], 1.2, 0.8, (200, 202, 206), (30, 32, 38), 150)
    board.absorb(tag, pose(3.35, 1.2, 0.232))


def _headers(board: Group) -> None:
    board.absorb(parts.header(15, 2), pose(4.0, -0.9, 0.006, rotation(z=90)))
    board.absorb(parts.header(13, 2), pose(-3.95, 0.35, 0.006, rotation(z=90)))
    board.absorb(parts.header(6, 1), pose(0.9, -3.15, 0.006))
    for k, x in enumerate((-0.6, -1.35, -2.1)):
        shell = box(0.6, 0.55, 0.5, 0.04).at(x, -3.1, 0.01)
        board.add(shell, plain("e9e5d6", 0.5))
        board.add(box(0.45, 0.3, 0.02, 0.004).at(x, -3.15, 0.51), plain("2a2a2c", 0.7))
        for pin in (-0.12, 0.0, 0.12):
            board.add(box(0.04, 0.04, 0.03, 0.004).at(x + pin, -3.15 + 0.02 * k, 0.52), GOLD)


def _passives(board: Group, rng: Generator) -> None:
    """Add capacitors, coils, a crystal, and many small resistors where nothing else stands."""
    for x, y, r, h in (
        (2.9, 0.15, 0.2, 0.5),
        (3.35, 0.15, 0.2, 0.5),
        (-3.1, -1.5, 0.27, 0.65),
        (-2.45, -1.5, 0.27, 0.65),
    ):
        board.absorb(parts.capacitor(r, h), pose(x, y, 0.006))
    for x, y in ((1.2, -1.3), (-0.3, -1.75)):
        board.add(box(0.62, 0.62, 0.32, 0.08).at(x, y, 0.01), plain("4a4c50", 0.6))
        tag = parts.decal(["2R2"], 0.45, 0.3, (74, 76, 80), (216, 216, 210), 150)
        board.absorb(tag, pose(x, y, 0.33))
    crystal = lathe([(0.17, 0), (0.17, 0.18), (0.14, 0.2), (0, 0.2)], 20)
    board.add(crystal.transformed(np.diag([2.2, 1, 1, 1])).at(1.05, 1.9, 0.01), STEEL)
    ends, ceramic = plain("cfd0d2", 0.35, 1.0), (plain("1a1a1c", 0.5), plain("b08a5a", 0.5))
    taken = [(-0.9, 0.25, 1.75, 1.75), (3.35, 1.2, 0.85, 0.7), (4.0, -0.9, 0.35, 2.0)]
    taken += [
        (-3.95, 0.35, 0.35, 1.8),
        (0, 2.9, 4.4, 1.3),
        (1.75, 1.0, 0.75, 0.7),
        (1.8, -0.35, 0.7, 0.65),
    ]
    taken += [
        (2.3, -1.7, 0.7, 0.7),
        (0, -3.1, 4.4, 0.45),
        (-2.6, -1.5, 0.9, 0.4),
        (-4.1, -1.9, 0.6, 0.5),
    ]
    for _ in range(150):
        x, y = rng.uniform([-4.1, -2.6], [4.1, 1.7])
        if any(abs(x - a) < w and abs(y - b) < d for a, b, w, d in taken):
            continue
        small, turn = Group(), 90.0 * rng.integers(2)
        small.add(box(0.1, 0.09, 0.055, 0.008), ceramic[int(rng.integers(2))])
        for side in (-1, 1):
            small.add(box(0.045, 0.095, 0.06, 0.008).at(x=side * 0.07), ends)
        board.absorb(small, pose(float(x), float(y), 0.006, rotation(z=float(turn))))


def _cables(board: Group) -> None:
    """Add the aerial's thin lead with its connector, a lit diode, and three jumper wires."""
    board.add(cylinder(0.11, 0.12, 0.02, 14).at(3.9, 1.55, 0.22), GOLD)
    lead = [[3.9, 1.55, 0.36], [3.2, 0.7, 0.75], [1.4, -1.0, 0.9], [-0.3, -1.3, 1.3]]
    lead += [[-2.3, -1.2, 1.1], [-3.2, -2.4, 0.4]]
    board.absorb(parts.wire(lead, 0.035, "1a1a1c"), np.eye(4))
    patch = parts.decal(["ANT 2.4G"], 1.5, 0.55, (222, 190, 70), (30, 28, 24), 150)
    board.absorb(patch, pose(-3.3, -2.75, 0.06, rotation(z=8)))
    board.add(box(1.5, 0.55, 0.06, 0.01).turned(z=8).at(-3.3, -2.75, 0.006), plain("3a3328", 0.5))
    for k, colour in enumerate(("b3261e", "17181a", "d9a520", "2f8f4e")):
        x = 0.4 + 0.254 * k
        path = [[x, -3.15, 0.85], [x + 0.1, -2.9, 1.5], [2.6 + 0.1 * k, -1.9, 1.3]]
        path += [[3.6, -1.6 + 0.254 * k, 1.4], [3.87, -1.66 + 0.254 * k, 0.86]]
        board.absorb(parts.wire(path, 0.042, colour), np.eye(4))
        for spot in (path[0], path[-1]):
            board.add(box(0.2, 0.2, 0.6, 0.02).at(spot[0], spot[1], 0.4), BLACK, Part.REST)
    board.add(box(0.09, 0.14, 0.07, 0.01).at(-3.3, 1.55, 0.006), plain("e23b2e", 0.2))
