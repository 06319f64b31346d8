"""Low electronic things that lie on a desk: phone, calculator, keyboard, mouse, bread board.

Every function builds one :class:`Item` about the origin, standing on z = 0, from a generator.
"""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.surfaces import print as sheets
from mattgs_ops.synthetic.surfaces.materials import BLACK, GOLD, Material, plain, rgb
from mattgs_ops.synthetic.surfaces.mesh import ball, box, curve, cylinder, quad, tube
from mattgs_ops.synthetic.surroundings.item import Item, bright


def phone(rng: Generator) -> Item:
    """Return a telephone showing its icons."""
    item = Item(7.4, 15, 0.9)
    sheet = sheets.Sheet(360, 760, (12, 12, 14))
    sheet.paste(sheets.picture(rng, 336, 716), 12, 22)
    for k in range(20):
        x, y = 36 + 78 * (k % 4), 130 + 98 * (k // 4)
        colour = rgb(rng.uniform(40, 250, 3))
        sheet.draw.rounded_rectangle((x, y, x + 54, y + 54), 13, fill=colour)
        sheet.centred(x + 27, y + 66, sheets.phrase(rng, 1), 13, (240, 240, 240), "DejaVuSans")
    sheet.centred(180, 80, f"{rng.integers(8, 20)}:{rng.integers(10, 59)}", 60, (250, 250, 250))
    item.group.add(box(7.4, 15, 0.8, 0.18), plain("22252b", 0.25, 0.4))
    item.group.add(quad(7.05, 14.6).at(z=0.81), Material(sheet.array(), 0.12))
    return item


def calculator(rng: Generator) -> Item:
    """Return a pocket calculator with its keys."""
    item = Item(8, 13, 1.7)
    item.group.add(box(8, 13, 1.1, 0.3), plain("3a3e46", 0.5))
    show = sheets.label([f"{rng.uniform(1, 99999):.3f}"], 260, 80, (160, 172, 150), (25, 30, 25))
    item.group.add(quad(6.6, 2.0).at(y=4.6, z=1.12), Material(show, 0.2))
    numbers = ("7", "8", "9", "÷", "√", "4", "5", "6", "\u00d7", "%", "1", "2", "3", "\u2212", "M")
    names = (*numbers, "0", ".", "=", "+", "C")
    for k, name in enumerate(names):
        x, y = -2.9 + 1.45 * (k % 5), 1.8 - 1.7 * (k // 5)
        paper = (190, 70, 50) if name == "C" else (60, 62, 68) if k % 5 < 3 else (110, 114, 122)
        face = sheets.label([name], 64, 64, paper, (240, 240, 236))
        item.group.add(box(1.15, 1.25, 1.5, 0.12).at(x, y), plain("5a5d64", 0.5))
        item.group.add(quad(0.9, 1.0).at(x, y, 1.51), Material(face, 0.5))
    return item


def keyboard(rng: Generator) -> Item:
    """Return a compact keyboard, every key a block with its legend."""
    dark = bool(rng.random() < 0.6)
    item = Item(30, 12, 2.4)
    case, cap, ink = (
        ("24262b", "33363c", (225, 225, 220)) if dark else ("b9b8b2", "dcdad3", (50, 50, 55))
    )
    item.group.add(box(30, 12, 1.4, 0.3), plain(case, 0.5))
    rows = ("`1234567890-=", "QWERTYUIOP[]#", "ASDFGHJKL;'@/", "ZXCVBNM,.<>?!", "~^&*()  _+{}|")
    paper = tuple(int(cap[i : i + 2], 16) for i in (0, 2, 4))
    atlas = sheets.Sheet(13 * 64, 5 * 64, (paper[0], paper[1], paper[2]))
    for j, row in enumerate(rows):
        for i, letter in enumerate(row):
            atlas.centred(64 * i + 26, 64 * j + 26, letter, 30, ink, "DejaVuSans")
    legends, plastic = Material(atlas.array(), 0.5), plain(cap, 0.5)
    for j in range(5):
        for i in range(13):
            x, y = -13.2 + 2.2 * i, 4.4 - 2.2 * j
            item.group.add(box(1.85, 1.85, 0.9, 0.18).at(x, y, 1.3), plastic)
            top = quad(1.45, 1.45).with_uv(i / 13, j / 5, (i + 1) / 13, (j + 1) / 5)
            item.group.add(top.at(x, y, 2.21), legends)
    return item


def mouse(rng: Generator) -> Item:
    """Return a computer mouse."""
    item = Item(6.4, 11, 3.6)
    shell = ball(1, 36).transformed(np.diag([3.1, 5.4, 2.1, 1.0]))  # its lower half is in the desk
    item.group.add(shell, plain("2a2c30", 0.4))
    seam = ball(1, 36).transformed(np.diag([0.06, 5.2, 2.14, 1.0])).at(y=0.1)
    item.group.add(seam, plain("0a0a0b", 0.7))
    item.group.add(cylinder(0.75, 0.7, 0.15).turned(y=90).at(-0.35, 2.6, 1.55), bright(rng))
    return item


def circuit(rng: Generator) -> Item:
    """Return a bread board with wires plugged in."""
    item = Item(16.5, 5.5, 2.6)
    sheet = sheets.Sheet(1320, 440, (232, 230, 222))
    for i in range(63):
        for j in range(10):
            x, y = 35 + 20 * i, 90 + 24 * j + (30 if j > 4 else 0)
            sheet.draw.rectangle((x - 3, y - 3, x + 3, y + 3), fill=(60, 60, 60))
        if i % 5 == 0:
            sheet.centred(35 + 20 * i, 72, str(i), 15, (90, 90, 95), "DejaVuSans")
    for y, colour in (
        (22, (200, 40, 40)),
        (52, (40, 60, 180)),
        (400, (200, 40, 40)),
        (426, (40, 60, 180)),
    ):
        sheet.draw.line((20, y, 1300, y), fill=colour, width=3)
    item.group.add(box(16.5, 5.5, 0.9, 0.08), plain("e6e4dc", 0.6))
    item.group.add(quad(16.4, 5.4).at(z=0.91), Material(sheet.array(), 0.6))
    for _ in range(11):
        a, b = rng.uniform([-7.5, -1.8], [7.5, 1.8], (2, 2))
        top = 0.9 + 0.25 * float(np.linalg.norm(a - b)) * rng.uniform(0.6, 1.2) + 0.5
        middle = (a + b) / 2 + rng.normal(0, 0.5, 2)
        path = curve([[*a, 0.9], [*a, 1.3], [*middle, min(top, 2.6)], [*b, 1.3], [*b, 0.9]], 8)
        item.group.add(tube(path, 0.09, 7), bright(rng))
    for _ in range(3):
        along = float(rng.uniform(-6, 6))
        item.group.add(box(2.0, 0.75, 0.4, 0.06).at(along, 0.1, 1.0), BLACK)
    for _ in range(7):
        place = rng.uniform([-7, -1.8], [7, 1.8])
        item.group.add(cylinder(0.25, 0.8, 0.2, 14).at(place[0], place[1], 1.1), bright(rng, 0.15))
        item.group.add(cylinder(0.04, 0.4).at(place[0], place[1], 0.8), GOLD)
    return item
