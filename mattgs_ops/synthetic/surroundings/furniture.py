"""Tall things at the desk's edge and around it: books, boxes, mugs, a lamp, shelves, posters."""

import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.surfaces import print as sheets
from mattgs_ops.synthetic.surfaces import textures
from mattgs_ops.synthetic.surfaces.materials import (
    BLACK,
    STEEL,
    WHITE,
    Group,
    Material,
    Part,
    plain,
    pose,
)
from mattgs_ops.synthetic.surfaces.mesh import (
    ball,
    box,
    curve,
    cylinder,
    lathe,
    quad,
    rotation,
    tube,
)
from mattgs_ops.synthetic.surroundings.clutter import pencil
from mattgs_ops.synthetic.surroundings.item import BRIGHT, Item, bright


def book(rng: Generator, height: float, depth: float, thickness: float) -> Group:
    """Return a book standing upright, its spine towards -y."""
    group = Group()
    colour = str(rng.choice(BRIGHT))
    paper = tuple(int(colour[i : i + 2], 16) for i in (0, 2, 4))
    long = int(34 * height)
    words = [sheets.phrase(rng, 2).upper(), sheets.phrase(rng, 2).title()]
    spine = sheets.label(
        words, long, max(int(34 * thickness), 24), (paper[0], paper[1], paper[2]), (240, 232, 205)
    )
    group.add(box(thickness, depth, height, 0.1), plain(colour, 0.45))
    group.add(
        box(thickness * 0.8, depth, height - 0.5, 0.02).at(0, 0.1, 0.35), plain("e3dcc8", 0.8)
    )
    face = (
        quad(height * 0.98, thickness * 0.94)
        .turned(z=90)
        .turned(x=90)
        .at(0, -depth / 2 - 0.01, height / 2)
    )
    group.add(face, Material(spine, 0.4))
    return group


def book_row(rng: Generator, width: float) -> Item:
    """Return books standing side by side, the last ones leaning."""
    item, x = Item(width, 17, 26), -width / 2
    while x < width / 2 - 4:
        thick, tall = float(rng.uniform(1.4, 4.2)), float(rng.uniform(17, 26))
        lean = float(rng.uniform(0, 3))
        item.group.absorb(book(rng, tall, 16, thick), pose(x + thick / 2, 0, 0, rotation(y=-lean)))
        x += thick + 0.15 + 0.05 * lean
    return item


def book_pile(rng: Generator) -> Item:
    """Return books lying on one another, the top one showing its cover."""
    item, z = Item(24, 18, 0), 0.0
    for _ in range(int(rng.integers(3, 6))):
        thick, tall, wide = (float(v) for v in rng.uniform([1.8, 19, 14], [4.2, 24, 17]))
        turn = rotation(z=float(rng.normal(0, 7))) @ rotation(y=90)
        item.group.absorb(book(rng, tall, wide, thick), pose(-tall / 2, 0, z + thick / 2, turn))
        z += thick
    image = sheets.cover(rng, 460, 620)
    item.group.add(quad(13, 18).turned(z=90).at(z=z + 0.03), Material(image, 0.35))
    item.height = z
    return item


def mug(rng: Generator) -> Item:
    """Return a glazed mug with something printed on it."""
    item = Item(12, 9, 9.5)
    glaze = plain(str(rng.choice(["e9e4d8", "345e7d", "8c3b2e", "d7c49a"])), 0.15)
    outer = [
        (0, 0),
        (3.6, 0),
        (4.0, 0.5),
        (4.1, 9.0),
        (3.95, 9.4),
        (3.8, 9.2),
        (3.7, 1.0),
        (0, 0.8),
    ]
    item.group.add(lathe(outer, 48), glaze)
    item.group.add(lathe([(3.7, 6.8), (0, 6.8)], 40), plain("2a1a10", 0.1))
    handle = [[4.0, 0, 7.6], [5.8, 0, 7.8], [6.6, 0, 5.4], [5.6, 0, 2.9], [4.0, 0, 2.4]]
    item.group.add(tube(curve(handle, 8), 0.5, 12), glaze)
    badge = sheets.label(
        [sheets.phrase(rng, 1).upper(), sheets.phrase(rng, 2)],
        500,
        220,
        (236, 230, 215),
        (150, 40, 35),
    )
    item.group.add(lathe([(4.13, 3.2), (4.13, 6.6)], 48), Material(np.tile(badge, (1, 3, 1)), 0.15))
    return item


def pencil_cup(rng: Generator) -> Item:
    """Return a tin full of pencils."""
    item = Item(9, 9, 20)
    image = sheets.label(
        [sheets.phrase(rng, 1).upper(), "FINE GROUND", "250 g"],
        420,
        300,
        (176, 40, 36),
        (244, 226, 180),
    )
    item.group.add(lathe([(3.9, 0.4), (3.9, 9.8)], 40), Material(np.tile(image, (1, 2, 1)), 0.3))
    rim = [
        (0, 0),
        (4, 0),
        (4, 0.4),
        (3.88, 0.4),
        (3.88, 9.8),
        (4, 9.9),
        (3.9, 10.2),
        (3.8, 9.9),
        (3.8, 0.5),
        (0, 0.5),
    ]
    item.group.add(lathe(rim, 40), STEEL)
    for _ in range(6):
        tilt = rotation(y=-90) @ rotation(x=float(rng.uniform(0, 360)))
        tilt = rotation(x=float(rng.normal(0, 9)), y=float(rng.normal(0, 9))) @ tilt
        x, y = rng.uniform(-2, 2, 2)
        item.group.absorb(pencil(rng).group, pose(x, y, 9, tilt))
    return item


def carton(rng: Generator) -> Item:
    """Return a shipping carton."""
    w, d, h = (float(v) for v in rng.uniform([20, 14, 12], [32, 22, 22]))
    item = Item(w, d, h)
    board = Material(textures.cardboard(rng, 640, int(640 * h / w)), 0.8)
    item.group.add(box(w, d, h, 0.15), plain("b08c62", 0.8))
    item.group.add(
        quad(w * 0.99, d * 0.99).at(z=h + 0.01), Material(textures.cardboard(rng, 640, 440), 0.8)
    )
    for turn, span, off in ((0, w, d), (180, w, d), (90, d, w), (270, d, w)):
        face = quad(span * 0.98, h * 0.97).turned(x=90).at(y=-off / 2 - 0.01, z=h / 2)
        item.group.add(face.turned(z=turn), board)
    return item


def product_box(rng: Generator) -> Item:
    """Return a colourful retail box with a cover on each side."""
    w, d, h = (float(v) for v in rng.uniform([13, 6, 17], [19, 9, 25]))
    item = Item(w, d, h)
    item.group.add(box(w, d, h, 0.08), bright(rng, 0.35))
    front = Material(sheets.cover(rng, 480, int(480 * h / w)), 0.3)
    side = Material(sheets.cover(rng, 240, int(240 * h / d)), 0.3)
    for turn, span, off, face in (
        (0, w, d, front),
        (180, w, d, front),
        (90, d, w, side),
        (270, d, w, side),
    ):
        sheet = quad(span * 0.98, h * 0.98).turned(x=90).at(y=-off / 2 - 0.01, z=h / 2)
        item.group.add(sheet.turned(z=turn), face)
    return item


def plant(rng: Generator) -> Item:
    """Return a pot plant with many leaves."""
    item = Item(16, 16, 26)
    item.group.add(
        lathe(
            [
                (0, 0),
                (4.5, 0),
                (5.8, 8.5),
                (6.2, 8.5),
                (6.2, 9.6),
                (5.6, 9.6),
                (5.4, 8.4),
                (0, 8.4),
            ],
            40,
        ),
        plain("b4633f", 0.75),
    )
    item.group.add(cylinder(5.4, 0.6).at(z=8.2), plain("2e2219", 0.95))
    greens = [plain(c, 0.45) for c in ("2f6b34", "3d7f3a", "4f8f45", "28562c")]
    for k in range(70):
        turn, lift = float(rng.uniform(0, 360)), float(rng.uniform(5, 75))
        long = float(rng.uniform(3, 6))
        leaf = quad(long, long * 0.42).at(x=long / 2).turned(x=float(rng.normal(0, 20)))
        stem = float(rng.uniform(0, 12))
        both = (leaf, leaf.turned(x=180))
        for side in both:
            x, y = rng.normal(0, 1.8, 2)
            item.group.add(side.turned(y=-lift, z=turn).at(x, y, 9 + stem), greens[k % 4])
    return item


def monitor(rng: Generator) -> Item:
    """Return a screen with windows full of text."""
    item = Item(48, 18, 38)
    sheet = sheets.Sheet(960, 560, (28, 40, 58))
    for _ in range(5):
        x, y = float(rng.uniform(10, 480)), float(rng.uniform(10, 250))
        dark = rng.random() < 0.5
        paper, ink = ((24, 26, 30), (170, 210, 170)) if dark else ((235, 235, 232), (40, 40, 44))
        sheet.draw.rectangle((x, y, x + 450, y + 290), fill=paper, outline=(120, 120, 130), width=2)
        sheet.draw.rectangle((x, y, x + 450, y + 22), fill=(90, 100, 120))
        sheets.paragraph(sheet, rng, (x + 10, y + 32, x + 440, y + 280), 13, ink, "DejaVuSansMono")
    item.group.add(box(48, 2.4, 29, 0.3).at(z=9), BLACK)
    item.group.add(quad(46.4, 27).turned(x=90).at(y=-1.22, z=23.5), Material(sheet.array(), 0.25))
    item.group.add(box(5, 2, 12, 0.3).at(y=2), BLACK)
    item.group.add(box(24, 17, 1.2, 0.4).at(y=1), BLACK)
    return item


def lamp(rng: Generator) -> Item:
    """Return a jointed desk lamp."""
    item, paint = Item(16, 16, 42), bright(rng, 0.3)
    item.group.add(cylinder(7.5, 1.8, 0.4, 40), paint)
    item.group.add(tube(curve([[0, 0, 1.5], [-4, 0, 20], [-4.2, 0, 21]], 4), 0.5, 10), STEEL)
    item.group.add(tube(curve([[-4.2, 0, 21], [5, 0, 37], [6, 0, 38]], 4), 0.5, 10), STEEL)
    item.group.add(ball(1.1).at(-4.2, 0, 21), BLACK)
    shade = lathe([(1.5, 6), (6, 0), (5.8, 0), (1.4, 5.8), (0, 6)], 36)
    item.group.add(shade.turned(y=25).at(7, 0, 33), paint)
    return item


def wall(rng: Generator, width: float, height: float) -> Group:
    """Return a wall facing -y about the origin with posters, a shelf of books and a socket."""
    group = Group()
    tone = [(214, 208, 196), (196, 204, 208), (206, 196, 180), (188, 196, 184)][rng.integers(4)]
    image = textures.plaster(rng, 700, int(700 * height / width), tone)
    group.add(quad(width, height).turned(x=90).at(z=height / 2), Material(image, 0.85))
    x = -width / 2 + 30
    while x < width / 2 - 30:
        w = float(rng.uniform(28, 52))
        h = w * float(rng.uniform(1.15, 1.45))
        z = float(rng.uniform(75, 100))
        group.add(
            box(w + 2.4, 1.2, h + 2.4, 0.2).at(x + w / 2, -0.7, z - h / 2 - 1.2),
            plain("2b2623", 0.4),
        )
        poster = Material(sheets.cover(rng, 440, int(440 * h / w)), 0.45)
        group.add(quad(w, h).turned(x=90).at(x + w / 2, -1.35, z), poster)
        x += w + float(rng.uniform(8, 26))
    return group


def shelf(rng: Generator, width: float, levels: int, pitch: float = 34) -> Group:
    """Return a bookcase facing -y, its boards full of books and boxes."""
    group, timber = Group(), plain("8a6a48", 0.55)
    for level in range(levels + 1):
        group.add(box(width, 24, 2, 0.15).at(z=level * pitch), timber)
    for side in (-1, 1):
        group.add(box(2, 24, levels * pitch + 2, 0.15).at(x=side * width / 2), timber)
    group.add(box(width, 1, levels * pitch).at(y=12), plain("6d5238", 0.7))
    for level in range(levels):
        item = book_row(rng, width * 0.62)
        group.absorb(item.group, pose(-width * 0.17, 0, level * pitch + 2))
        group.absorb(
            product_box(rng).group, pose(width * 0.32, 0, level * pitch + 2, rotation(z=8))
        )
    return group


def floor(rng: Generator, size: float) -> Group:
    """Return a floor of dark boards."""
    group = Group()
    image = textures.wood(rng, 1600, 1600, (112, 84, 60), 22)
    group.add(quad(size, size), Material(image, 0.5))
    return group


def table(rng: Generator, width: float, depth: float, tone: tuple[float, float, float]) -> Group:
    """Return the desk: its top's surface at z = 0, legs below."""
    group = Group()
    image = textures.wood(rng, 3600, int(3600 * depth / width), tone, 6)
    group.add(quad(width - 0.2, depth - 0.2).at(z=0.001), Material(image, 0.38), Part.REST)
    group.add(box(width, depth, 3, 0.1).at(z=-3), plain("5d4630", 0.5))
    for x in (-1, 1):
        for y in (-1, 1):
            group.add(box(6, 6, 70, 0.3).at(x * (width / 2 - 6), y * (depth / 2 - 6), -73), WHITE)
    return group


TALL = (book_pile, mug, pencil_cup, carton, product_box, plant, monitor, lamp, product_box, mug)
