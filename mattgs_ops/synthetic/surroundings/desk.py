"""The surroundings of every capture: a desk full of things in a lit room.

Things are laid by rings: sheets anywhere, small and low things between the object and the cameras,
so that they never hide the object, tall things beyond the cameras.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from mattgs_ops.synthetic.surfaces.materials import Group, Stage, pose
from mattgs_ops.synthetic.surfaces.mesh import rotation
from mattgs_ops.synthetic.surroundings import clutter, furniture
from mattgs_ops.synthetic.surroundings.item import Item

CELL = 0.5  # centimetres a cell of the occupancy grid is wide
HALF = 100.0  # centimetres the grid reaches to each side
WALL = 175.0  # distance of the walls from the object, centimetres
FLOOR = -73.0  # height of the floor

Cells = NDArray[np.int64]
Make = Callable[[Generator], Item]


@dataclass(frozen=True)
class Layout:
    """How a desk is laid.

    ``clear`` is the radius around the object that stays free of things with a height, ``reach``
    the horizontal distance of the nearest cameras, ``keep`` a little more than that of the farthest
    ones: tall things stay outside. All three are centimetres. ``under`` lies beneath the
    object at a given angle in degrees.
    """

    clear: float
    reach: float
    tone: tuple[float, float, float]
    under: tuple[tuple[Make, float, float, float], ...] = ()
    sheets: int = 14
    small: int = 20
    low: int = 26
    tall: int = 14
    slope: float = 1.0  # height allowed per centimetre beyond half of ``clear``
    keep: float = 0.0  # 0: 1.12 times ``reach``


class Occupancy:
    """Which cells of the desk are taken."""

    def __init__(self, width: float, depth: float) -> None:
        count = int(2 * HALF / CELL)
        self.taken = np.zeros((count, count), dtype=bool)
        axis = (np.arange(count) + 0.5) * CELL - HALF
        self.taken |= (np.abs(axis) > depth / 2 - 1)[:, None] | (np.abs(axis) > width / 2 - 1)

    def cells(self, x: float, y: float, width: float, depth: float, turn: float) -> Cells:
        """Return the grid indices [K, 2] under a turned rectangle."""
        u, v = np.meshgrid(
            np.arange(-width / 2, width / 2 + CELL / 2, CELL / 2),
            np.arange(-depth / 2, depth / 2 + CELL / 2, CELL / 2),
        )
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        px, py = x + c * u - s * v, y + s * u + c * v
        out = np.stack([(py + HALF) / CELL, (px + HALF) / CELL], axis=-1).reshape(-1, 2)
        cells: Cells = np.clip(out.astype(np.int64), 0, len(self.taken) - 1)
        return cells

    def try_take(self, x: float, y: float, item: Item, turn: float, keep: float = 0.0) -> bool:
        """Take the cells under an item if all are free and none nearer than ``keep``; say so."""
        cells = self.cells(x, y, item.width, item.depth, turn)
        if np.hypot(*((cells + 0.5) * CELL - HALF).T).min() < keep:
            return False
        if self.taken[cells[:, 0], cells[:, 1]].any():
            return False
        self.taken[cells[:, 0], cells[:, 1]] = True
        return True

    def take_disc(self, radius: float) -> None:
        """Take a disc about the origin."""
        axis = (np.arange(len(self.taken)) + 0.5) * CELL - HALF
        self.taken |= axis[:, None] ** 2 + axis[None] ** 2 < radius**2


def furnish(stage: Stage, rng: Generator, layout: Layout) -> float:
    """Put desk, clutter and room on the stage; return the height of what lies at the origin."""
    width, depth = 170.0, 150.0
    furniture.table(rng, width, depth, layout.tone).place(stage, np.eye(4), own=False)
    top = 0.0
    for make, x, y, turn in layout.under:
        item = make(rng)
        item.group.place(stage, pose(x, y, top, rotation(z=turn)), own=False)
        top += item.height
    _lay_sheets(stage, rng, layout, top)
    space = Occupancy(width, depth)
    space.take_disc(layout.clear)
    tall = [furniture.TALL[i % len(furniture.TALL)] for i in range(layout.tall)]
    keep = layout.keep or 1.12 * layout.reach
    scatter(stage, rng, space, tall, keep, min(105.0, keep + 50), keep=keep)
    low = [clutter.LOW[i] for i in rng.permutation(len(clutter.LOW) * 2) % len(clutter.LOW)]
    near, far = layout.clear * 1.2, layout.reach * 1.5
    scatter(stage, rng, space, low[: layout.low], near, far, limit=layout)
    small = [clutter.SMALL[i % len(clutter.SMALL)] for i in range(layout.small)]
    near, far = layout.clear * 0.9, layout.reach * 0.95
    scatter(stage, rng, space, small, near, far, lift=top, limit=layout)
    _room(stage, rng)
    return top


def _lay_sheets(stage: Stage, rng: Generator, layout: Layout, top: float) -> None:
    """Lay overlapping sheets around what lies under the object, each a little above the last."""
    lift = max(top, 0.0) + 0.02
    for k in range(layout.sheets):
        item = clutter.SHEETS[k % len(clutter.SHEETS)](rng)
        angle = 2 * np.pi * (k * 0.618 + rng.uniform(-0.05, 0.05))
        radius = (
            layout.clear + 0.42 * max(item.width, item.depth) + rng.uniform(0, 1.0) * layout.reach
        )
        radius = min(radius, 62.0)
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        turn = rotation(z=float(rng.uniform(0, 360)))
        item.group.place(stage, pose(float(x), float(y), lift, turn), own=False)
        lift += 0.02


def scatter(
    stage: Stage,
    rng: Generator,
    space: Occupancy,
    makes: Sequence[Make],
    near: float,
    far: float,
    *,
    keep: float = 0.0,
    lift: float = 0.3,
    limit: Layout | None = None,
) -> None:
    """Put things at random free places between two radii; those that find none are left out."""
    for make in makes:
        item = make(rng)
        for _ in range(60):
            angle = rng.uniform(0, 2 * np.pi)
            radius = np.sqrt(rng.uniform(near**2, far**2))
            x, y = float(radius * np.cos(angle)), float(radius * np.sin(angle))
            turn = float(rng.uniform(0, 360))
            if keep:  # the front, -y, looks at the object, more or less
                turn = float(np.degrees(angle) - 90 + rng.normal(0, 25))
            if limit and item.height > limit.slope * (radius - limit.clear / 2):
                continue
            if space.try_take(x, y, item, turn, keep):
                item.group.place(stage, pose(x, y, lift, rotation(z=turn)), own=False)
                break


def _room(stage: Stage, rng: Generator) -> None:
    room = Group()
    room.absorb(furniture.floor(rng, 2 * WALL), pose(0, 0, FLOOR))
    for k, turn in enumerate((0, 90, 180, 270)):
        frame = rotation(z=turn)
        inner = furniture.wall(rng, 2 * WALL, 215)
        room.absorb(inner, frame @ pose(0, WALL, FLOOR))
        for x in (-95, 20, 105):
            height = 3 if (k + x) % 2 else 2
            case = furniture.shelf(rng, float(rng.uniform(60, 85)), height)
            room.absorb(case, frame @ pose(x + float(rng.uniform(-8, 8)), WALL - 14, FLOOR))
    room.place(stage, np.eye(4), own=False)
