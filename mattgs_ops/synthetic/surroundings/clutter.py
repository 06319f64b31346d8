"""Low things that lie on a desk: paper, pens, tools, parts.

Every function builds one :class:`Item` about the origin, standing on z = 0, from a generator.
"""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.surfaces import print as sheets
from mattgs_ops.synthetic.surfaces import textures
from mattgs_ops.synthetic.surfaces.materials import (
    BLACK,
    BRASS,
    DARK_STEEL,
    STEEL,
    Material,
    plain,
    pose,
    rgb,
)
from mattgs_ops.synthetic.surfaces.mesh import (
    box,
    curve,
    cylinder,
    lathe,
    prism,
    quad,
    rotation,
    tube,
)
from mattgs_ops.synthetic.surroundings.gadgets import calculator, circuit, keyboard, mouse, phone
from mattgs_ops.synthetic.surroundings.item import Item, bright, flat


def newspaper(rng: Generator) -> Item:
    """Return a newspaper's front page, folded to 28 × 38 cm."""
    return flat(sheets.newspaper(rng, 980, 1330), 28, 38, 0.15)


def page(rng: Generator) -> Item:
    """Return a data sheet, A4."""
    return flat(sheets.page(rng, 800, 1130), 21, 29.7)


def magazine(rng: Generator) -> Item:
    """Return a magazine or a paperback lying on its back."""
    return flat(sheets.cover(rng, 640, 880), 17, 23.4, float(rng.uniform(0.3, 1.2)))


def leaflet(rng: Generator) -> Item:
    """Return a small printed card."""
    return flat(sheets.cover(rng, 420, 300), 10.5, 7.5, 0.03)


def sticky_note(rng: Generator) -> Item:
    """Return a note with a few words."""
    paper = ((246, 221, 98), (240, 150, 165), (150, 215, 160))[rng.integers(3)]
    sheet = sheets.Sheet(260, 260, paper)
    for k in range(4):
        face = "DejaVuSans-Oblique"
        sheet.text(18, 24 + 54 * k, sheets.phrase(rng, 2), 30, (35, 45, 110), face)
    return flat(sheet.array(), 7.6, 7.6, 0.04)


def pen(rng: Generator) -> Item:
    """Return a ball pen with a clip."""
    item, body = Item(14, 1.2, 1.1), bright(rng)
    profile = [
        (0, 0),
        (0.12, 0.05),
        (0.42, 1.6),
        (0.45, 2.5),
        (0.45, 10.5),
        (0.38, 11.5),
        (0.2, 12.2),
    ]
    shaft = lathe([*profile, (0.2, 13.4), (0, 13.4)], 18).turned(y=90).at(x=-7, z=0.45)
    item.group.add(shaft, body)
    item.group.add(cylinder(0.47, 0.5).turned(y=90).at(x=0.6, z=0.46), STEEL)
    item.group.add(box(4, 0.3, 0.12).at(x=3.2, z=0.98), STEEL)
    return item


def pencil(rng: Generator) -> Item:
    """Return a six-sided pencil."""
    item = Item(17, 1, 0.8)
    ring = [(0.38 * np.cos(a), 0.38 * np.sin(a)) for a in np.arange(6) * np.pi / 3]
    item.group.add(prism(ring, 14).turned(y=90).at(x=-7, z=0.33), bright(rng))
    tip = lathe([(0.36, 0), (0.08, 1.7), (0, 1.9)], 12)
    item.group.add(tip.turned(y=90).at(x=7, z=0.33), plain("c9a06a", 0.7))
    item.group.add(cylinder(0.36, 1.0).turned(y=90).at(x=-8, z=0.34), plain("c98b87", 0.8))
    return item


def screwdriver(rng: Generator) -> Item:
    """Return a screwdriver with a ribbed handle."""
    item, grip = Item(19, 2.6, 2.4), bright(rng, 0.3)
    profile = [
        (0, 0),
        (0.9, 0.1),
        (1.15, 0.6),
        (1.1, 2.5),
        (0.95, 4),
        (1.15, 6),
        (0.6, 7.6),
        (0.55, 8.2),
    ]
    item.group.add(lathe([*profile, (0, 8.2)], 24).turned(y=90).at(x=-9, z=1.15), grip)
    for k in range(8):
        a = k * np.pi / 4
        rib = cylinder(0.16, 4.6, segments=10).turned(y=90)
        item.group.add(rib.at(-8.3, 1.02 * np.cos(a), 1.15 + 1.02 * np.sin(a)), BLACK)
    item.group.add(cylinder(0.26, 9.6, 0.05, 14).turned(y=90).at(x=-0.9, z=1.15), STEEL)
    item.group.add(box(1.2, 0.55, 0.12, 0.02).at(x=8.9, z=1.09), DARK_STEEL)
    return item


def battery(rng: Generator) -> Item:
    """Return an AA cell."""
    item = Item(5.2, 1.5, 1.45)
    name = str(rng.choice(["VOLTEX", "ENERMAX", "PILACELL"]))
    image = sheets.label([name, "AA 1.5 V", "LR6"], 300, 220, (28, 28, 30), (214, 160, 60))
    wrap = lathe([(0.72, 0), (0.72, 4.8)], 26).turned(y=90).at(x=-2.5, z=0.72)
    item.group.add(wrap, Material(image, 0.3, 0.3))
    item.group.add(cylinder(0.72, 0.02).turned(y=90).at(x=-2.51, z=0.72), STEEL)
    item.group.add(cylinder(0.7, 0.03).turned(y=90).at(x=2.29, z=0.72), BRASS)
    item.group.add(cylinder(0.26, 0.25).turned(y=90).at(x=2.3, z=0.72), STEEL)
    return item


def coins(rng: Generator) -> Item:
    """Return a few coins."""
    item = Item(5, 5, 0.4)
    for k in range(int(rng.integers(2, 5))):
        metal = (BRASS, STEEL, plain("b8734a", 0.35, 1.0))[rng.integers(3)]
        radius, (x, y) = rng.uniform(0.85, 1.25), rng.uniform(-1.3, 1.3, 2)
        item.group.add(cylinder(radius, 0.16, 0.04).at(x, y, 0.17 * k), metal)
        ring = lathe([(radius * 0.86, 0.16), (radius * 0.86, 0.19), (radius * 0.8, 0.16)], 28)
        item.group.add(ring.at(x, y, 0.17 * k), metal)
    return item


def loose_screws(rng: Generator) -> Item:
    """Return screws and nuts that fell out of a box."""
    item = Item(6, 6, 0.5)
    for _ in range(9):
        x, y = rng.uniform(-2.6, 2.6, 2)
        if rng.random() < 0.65:
            long = rng.uniform(0.6, 1.4)
            shaft = cylinder(0.14, long, 0.02, 10).turned(y=90)
            matrix = pose(x, y, 0.24, rotation(z=float(rng.uniform(0, 360))))
            item.group.add(shaft.transformed(matrix), DARK_STEEL)
            head = cylinder(0.28, 0.22, 0.06, 14).turned(y=90).at(x=-0.22)
            item.group.add(head.transformed(matrix), STEEL)
        else:
            ring = [(0.3 * np.cos(a), 0.3 * np.sin(a)) for a in np.arange(6) * np.pi / 3]
            item.group.add(prism(ring, 0.22, 0.03).at(x, y), BRASS)
    return item


def ruler(rng: Generator) -> Item:
    """Return a steel or plastic ruler."""
    sheet = sheets.Sheet(1240, 120, (205, 206, 208) if rng.random() < 0.5 else (226, 192, 96))
    for k in range(301):
        tall = 46 if k % 10 == 0 else 32 if k % 5 == 0 else 20
        sheet.draw.line((20 + 4 * k, 0, 20 + 4 * k, tall), fill=(20, 20, 22), width=1)
        if k % 10 == 0:
            sheet.centred(20 + 4 * k, 62, str(k // 10), 22, (20, 20, 22), "DejaVuSans")
    sheet.text(820, 84, "STAINLESS  30 cm  DIN 866", 22, (40, 40, 46))
    return flat(sheet.array(), 31, 3, 0.1)


def cable(rng: Generator) -> Item:
    """Return a cable coiled twice with a plug at its end."""
    item, jacket = Item(15, 15, 1.6), plain(str(rng.choice(["1a1a1c", "d9d8d4", "8a1f1f"])), 0.5)
    turns = np.linspace(0, 4.4 * np.pi, 26)
    radius = 5 + 0.5 * np.sin(turns * 1.7) + 0.25 * rng.standard_normal(26)
    lift = 0.3 + 0.25 * (1 + np.sin(turns * 2.3)) * (turns / turns[-1])
    points = np.column_stack([radius * np.cos(turns), radius * np.sin(turns), lift])
    tail = points[-1] + np.array([[1.5, 1.0, -0.1], [3.0, 1.6, -0.2]])
    path = curve(np.concatenate([points, tail]).tolist(), 6)
    item.group.add(tube(path, 0.26, 10), jacket)
    end = path[-1]
    item.group.add(box(2.2, 1.3, 0.75, 0.15).at(end[0] + 1, end[1], 0.1), jacket)
    item.group.add(box(1.2, 1.0, 0.42, 0.05).at(end[0] + 2.6, end[1], 0.26), STEEL)
    return item


def parts_box(rng: Generator) -> Item:
    """Return a small carton with a printed lid."""
    w, d, h = (float(v) for v in rng.uniform([6, 4, 1.6], [11, 7.5, 3.2]))
    item, colour = Item(w, d, h), rgb(rng.uniform(20, 220, 3))
    pale = sum(colour) > 330
    ink = (22, 22, 26) if pale else (238, 236, 230)
    lines = [sheets.phrase(rng, 1).upper(), f"{rng.integers(10, 990)} pcs  M{rng.integers(2, 6)}"]
    lines += [sheets.phrase(rng, 3), f"No. {rng.integers(10**6, 10**7)}"]
    image = sheets.label(lines, 460, int(460 * d / w), colour, ink, bars=rng)
    hexed = "".join(f"{c:02x}" for c in colour)
    item.group.add(box(w, d, h, 0.08), plain(hexed, 0.5))
    item.group.add(quad(w * 0.97, d * 0.97).at(z=h + 0.01), Material(image, 0.4))
    side = sheets.label(lines[:2], 460, int(460 * h / w), colour, ink)
    for turn in (0, 180):
        face = quad(w * 0.96, h * 0.94).turned(x=90).at(y=-d / 2 - 0.01, z=h / 2).turned(z=turn)
        item.group.add(face, Material(side, 0.4))
    return item


def tape(rng: Generator) -> Item:
    """Return a roll of tape lying flat."""
    item, r = Item(9, 9, 2.2), float(rng.uniform(3.2, 4.3))
    item.group.add(lathe([(2.6, 0), (r, 0), (r, 2), (2.6, 2)], 40), bright(rng, 0.35))
    item.group.add(lathe([(2.6, 2.05), (2.3, 2.05), (2.3, 0), (2.6, 0)], 40), plain("b99a6b", 0.8))
    item.group.add(lathe([(2.3, 2.05), (2.6, 2.05)][::-1], 40), plain("b99a6b", 0.8))
    return item


def mat(rng: Generator) -> Item:
    """Return a cutting mat, A3."""
    return flat(textures.cutting_mat(rng, 45, 30, 34), 45, 30, 0.12)


def cloth(rng: Generator) -> Item:
    """Return a folded cloth."""
    tone = rng.uniform(60, 190, 3)
    image = textures.cloth(rng, 900, 700, (float(tone[0]), float(tone[1]), float(tone[2])))
    return flat(image, 30, 23, 0.25)


SHEETS = (newspaper, page, magazine, page, leaflet, mat, cloth, newspaper)
SMALL = (battery, coins, loose_screws, leaflet, sticky_note, pen, pencil, parts_box, screwdriver)
LOW = (
    *(keyboard, phone, screwdriver, parts_box, circuit, calculator, mouse, cable, tape, ruler),
    *(pen, pencil, battery, sticky_note, leaflet, coins, loose_screws, parts_box, magazine),
)
