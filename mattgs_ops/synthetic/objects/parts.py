"""Mechanical and electronic parts that the objects are built from: screws, wires, servos, chips.

Every function returns a :class:`Group` standing on z = 0 at the origin unless it says otherwise.
Screws, wires and print are marked as small structures.
"""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.surfaces import print as sheets
from mattgs_ops.synthetic.surfaces.materials import (
    ALUMINIUM,
    BLACK,
    DARK_STEEL,
    GOLD,
    STEEL,
    Group,
    Image,
    Material,
    Part,
    plain,
    pose,
    printed,
)
from mattgs_ops.synthetic.surfaces.mesh import (
    Array,
    box,
    curve,
    cylinder,
    lathe,
    quad,
    rotation,
    tube,
)

Rgb = tuple[int, int, int]


def screw(radius: float = 0.3, metal: Material = STEEL) -> Group:
    """Return a pan-head screw with a cross slot, its head upward."""
    group, tall = Group(), 0.55 * radius
    profile = [
        (radius, 0),
        (radius, 0.35 * tall),
        (0.86 * radius, 0.75 * tall),
        (0.55 * radius, tall),
    ]
    group.add(lathe([*profile, (0, tall)], 18), metal, Part.SCREW)
    for turn in (20, 110):
        slot = box(1.25 * radius, 0.26 * radius, 0.02, 0.002).turned(z=turn)
        group.add(slot.at(z=tall - 0.008), plain("141416", 0.6), Part.SCREW)
    return group


def screws(group: Group, places: Sequence[Sequence[float]], radius: float, metal: Material) -> None:
    """Add upright screws at the places (x, y, z)."""
    for x, y, z in places:
        group.absorb(screw(radius, metal), pose(x, y, z))


def wire(points: Sequence[Sequence[float]], radius: float, colour: str) -> Group:
    """Return a wire along a smooth curve through the points."""
    group = Group()
    group.add(tube(curve(points, 9), radius, 7), plain(colour, 0.4), Part.WIRE)
    return group


def decal(
    lines: list[str], width: float, depth: float, paper: Rgb, ink: Rgb, density: int = 60
) -> Group:
    """Return a printed label lying at z = 0.01; ``density`` in pixels per centimetre."""
    image = sheets.label(lines, int(width * density), int(depth * density), paper, ink)
    group = Group()
    group.add(quad(width, depth).at(z=0.01), printed(image, paper))
    return group


def picture_decal(image: Image, width: float, depth: float, paper: Rgb) -> Group:
    """Return an image lying at z = 0.01, what differs from the paper's colour being print."""
    group = Group()
    group.add(quad(width, depth).at(z=0.01), printed(image, paper))
    return group


def board_print(
    rng: Generator, width: float, depth: float, base: Rgb, title: str, density: int = 90
) -> Group:
    """Return the face of a circuit board at z = 0.01: traces, vias, designators, a title."""
    sheet = sheets.Sheet(int(width * density), int(depth * density), base)
    trace: Rgb = (base[0] + 12, base[1] + 26, base[2] + 16)
    for _ in range(60):
        x, y = rng.uniform(0, sheet.width), rng.uniform(0, sheet.height)
        reach = rng.normal(0, 60, 2)
        path = [(x, y), (x + reach[0], y), (x + reach[0] + reach[1], y + reach[1])]
        sheet.draw.line(path, fill=trace, width=3)
        sheet.draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=(206, 170, 90))
    for k in range(14):
        x, y = rng.uniform(20, sheet.width - 90), rng.uniform(60, sheet.height - 60)
        sheet.text(x, y, f"{'RCUQD'[k % 5]}{rng.integers(1, 60)}", 18, (232, 236, 230))
    sheet.text(30, sheet.height - 70, title, 34, (232, 236, 230), "DejaVuSans-Bold")
    return picture_decal(sheet.array(), width, depth, base)


def chip(width: float, depth: float, lines: list[str], height: float = 0.15) -> Group:
    """Return an integrated circuit with print and legs on two sides."""
    group = Group()
    group.add(box(width, depth, height, 0.025).at(z=0.03), plain("1d1e21", 0.5))
    image = sheets.label(lines, int(130 * width), int(130 * depth), (30, 31, 34), (205, 205, 200))
    face = quad(width * 0.92, depth * 0.92).at(z=height + 0.035)
    group.add(face, printed(image, (30, 31, 34), 0.5))
    count = max(int(width / 0.13), 3)
    for x in (np.arange(count) - (count - 1) / 2) * 0.13:
        for side in (-1, 1):
            leg = box(0.055, 0.14, 0.05, 0.01)
            group.add(leg.at(float(x), side * (depth / 2 + 0.06), 0.01), STEEL)
    return group


def header(columns: int, rows: int, pitch: float = 0.254, height: float = 0.85) -> Group:
    """Return a pin header."""
    group = Group()
    group.add(box(columns * pitch, rows * pitch, 0.25, 0.03), BLACK)
    for x in (np.arange(columns) - (columns - 1) / 2) * pitch:
        for y in (np.arange(rows) - (rows - 1) / 2) * pitch:
            group.add(box(0.062, 0.062, height, 0.01).at(float(x), float(y), 0.02), GOLD)
    return group


def capacitor(radius: float, height: float, text: str = "") -> Group:
    """Return an electrolytic capacitor with its dark mark, and print where there is text."""
    group = Group()
    group.add(box(2.15 * radius, 2.15 * radius, 0.08, 0.02), BLACK)
    profile = [(radius, 0.06), (radius, 0.16), (0.94 * radius, 0.2), (radius, 0.25)]
    profile += [(radius, height - 0.05), (radius - 0.05, height), (0, height)]
    group.add(lathe(profile, 28), ALUMINIUM)
    lines = [text, "35V"] if text else ["220", "16V"]
    top = decal(lines, 1.1 * radius, 1.1 * radius, (196, 197, 200), (25, 25, 30), 130)
    group.absorb(top, pose(0, 0, height))
    mark = box(0.5 * radius, 1.5 * radius, 0.012, 0.002).at(x=-0.66 * radius, z=height)
    group.add(mark, plain("22242a", 0.4))
    return group


def servo(name: str, body: str = "1c1d20") -> Group:
    """Return a standard servo, 4 × 2 × 3.6 cm with its shaft up, its lugs at z = 2.6."""
    group = Group()
    group.add(box(4.0, 2.0, 3.6, 0.08), plain(body, 0.45))
    group.add(box(4.04, 2.04, 0.06, 0.01).at(z=0.9), plain("0c0c0d", 0.6))
    group.add(box(5.4, 1.9, 0.28, 0.05).at(z=2.6), plain(body, 0.45))
    screws(group, [(x, y, 2.88) for x in (-2.4, 2.4) for y in (-0.5, 0.5)], 0.24, STEEL)
    screws(group, [(x, y, 3.6) for x in (-1.7, 1.7) for y in (-0.75, 0.75)], 0.14, DARK_STEEL)
    group.add(cylinder(0.62, 0.3, 0.06).at(x=1.0, z=3.58), plain("2b2c30", 0.4))
    group.add(cylinder(0.3, 0.65, 0.04, 18).at(x=1.0, z=3.58), plain("c2a050", 0.32, 1.0))
    lines = [name, "DIGITAL SERVO", "4.8-6.8V 15KG"]
    image = sheets.label(lines, 400, 190, (196, 34, 32), (244, 242, 236))
    for turn in (0, 180):
        face = quad(3.5, 1.5).turned(x=90).at(y=-1.012, z=1.72).turned(z=turn)
        group.add(face, printed(image, (196, 34, 32), 0.35))
    end = quad(1.6, 1.3).turned(x=90).turned(z=90).at(2.012, 0, 1.75)
    small = sheets.label([name, "180°"], 200, 160, (235, 232, 224), (20, 20, 24))
    group.add(end, printed(small, (235, 232, 224), 0.4))
    for k, colour in enumerate(("6b4226", "b3261e", "d98e1f")):
        y = (k - 1) * 0.13
        group.absorb(wire([[-2, y, 0.35], [-2.5, y, 0.4], [-2.9, y, 0.9]], 0.06, colour), np.eye(4))
    return group


def beam(start: Array, end: Array, width: float, thickness: float, material: Material) -> Group:
    """Return a flat bar between two points of one vertical plane x–z, thick along y."""
    delta = end - start
    long = float(np.hypot(delta[0], delta[2]))
    angle = float(np.degrees(np.arctan2(delta[2], delta[0])))
    bar = box(long + width, thickness, width, 0.12).at(z=-width / 2).turned(y=-angle)
    group, middle = Group(), (start + end) / 2
    group.add(bar.at(*middle), material)
    return group


def side_screw(x: float, y: float, z: float, side: int, radius: float, metal: Material) -> Group:
    """Return a screw at a point whose head looks along +y (``side`` 1) or -y (-1)."""
    group = Group()
    group.absorb(screw(radius, metal), pose(x, y, z, rotation(x=-90 * side)))
    return group
