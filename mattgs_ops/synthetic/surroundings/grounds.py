"""Grounds that objects are photographed on besides the cluttered desk.

Black cloth and a white sweep under soft lamps; a turntable, where room and light stand still before
the camera while the object turns; a bare wooden table; a dark room lit by a flash on the camera;
the floor of a wood.
``lay`` builds one of :data:`GROUNDS` from a generator; lengths are centimetres, z = 0 is the top of
what the object stands on unless ``top`` says otherwise.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import Generator

from mattgs_ops.errors import InputError
from mattgs_ops.synthetic.surfaces import textures
from mattgs_ops.synthetic.surfaces.materials import Material, Stage, plain, pose
from mattgs_ops.synthetic.surfaces.mesh import Mesh, box, cylinder, lathe, quad, rotation
from mattgs_ops.synthetic.surfaces.print import noise
from mattgs_ops.synthetic.surroundings import clutter, furniture
from mattgs_ops.synthetic.surroundings.desk import FLOOR, Layout, furnish
from mattgs_ops.synthetic.surroundings.woods import woods
from mattgs_ops.synthetic.tracer import room_light

GROUNDS = (
    "black-cloth",
    "white-sweep",
    "turntable",
    "wooden-table",
    "dark-flash",
    "cluttered-desk",
    "woods",
)
COVE, RISE, WALL = 75.0, 45.0, 170.0  # radius of the flat, of the bend, height of the edge
ROOM = 175.0  # distance of the walls
PLATE, PLATE_HEIGHT = 17.0, 1.4  # the turntable's disc
FLASH = "flash"  # the lamp that moves with the camera
FLASH_POWER = 6500.0  # intensity: a pale thing half a metre away is exposed well
CLEAR, REACH = 16.0, 38.0  # the desk's, as in the bundled captures


@dataclass(frozen=True)
class Ground:
    """What surrounds the object.

    ``light`` holds the tracer's lamps. ``flash``: the lamp :data:`FLASH` is at the camera.
    ``follows``: stage and light stand still before the camera, the object turns. ``spread`` is the
    standard deviation of the logarithm of the exposure from photo to photo.
    """

    stage: Stage
    light: dict[str, Any]
    top: float = 0.0
    flash: bool = False
    follows: bool = False
    spread: float = 0.05
    turning: Stage = field(default_factory=Stage)  # turns with the object: the turntable's plate


def lay(name: str, rng: Generator, layout: Layout | None = None) -> Ground:
    """Build a ground by name; raises :class:`InputError` for unknown ones.

    ``layout`` is the cluttered desk's.
    """
    if name not in GROUNDS:
        raise InputError(f"ground {name!r}: expected one of {', '.join(GROUNDS)}")
    angle = float(rng.uniform(0, 360))
    if name == "black-cloth":
        tone = float(rng.uniform(3, 9))
        return Ground(_cove(rng, (tone, tone, tone * 1.05), 0.25), soft_light(0.6, 26, angle))
    if name == "white-sweep":
        tone = float(rng.uniform(222, 246))
        return Ground(_cove(rng, (tone, tone, tone * 0.99), 0.01), soft_light(1.3, 14, angle))
    if name == "turntable":
        return _turntable(rng, angle)
    if name == "wooden-table":
        return Ground(_table(rng), room_light(float(rng.uniform(0.85, 1.15)), angle))
    if name == "dark-flash":
        return Ground(_table(rng), flash_light(), flash=True, spread=0.2)
    if name == "woods":
        return Ground(woods(rng), soft_light(0.9, 14, angle), spread=0.08)
    stage = Stage()
    r, g, b = (int(v) for v in rng.uniform((110, 80, 60), (215, 190, 160)))
    desk = layout or Layout(CLEAR, REACH, (r, g, b), keep=58)
    return Ground(stage, room_light(1.0, angle), furnish(stage, rng, desk))


def soft_light(dome: float, key: float, angle: float) -> dict[str, Any]:
    """Return a bright dome and one large lamp; ``dome`` and ``key`` are radiances, degrees."""
    import mitsuba as mi

    around = np.radians(angle)
    place = [70 * np.cos(around), 70 * np.sin(around), 150.0]
    frame = mi.ScalarTransform4f().look_at(place, [0, 0, 0], [0, 0, 1]).scale([24, 24, 1])
    return {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [dome] * 3}},
        "lamp": {
            "type": "rectangle",
            "to_world": frame,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [key] * 3}},
        },
    }


def flash_light() -> dict[str, Any]:
    """Return a small bright lamp, to be moved to the camera, and a trace of light besides."""
    dim = {"type": "rgb", "value": [0.012, 0.011, 0.01]}
    bright = {"type": "rgb", "value": [FLASH_POWER] * 3}
    return {
        "sky": {"type": "constant", "radiance": dim},
        FLASH: {"type": "point", "position": [0, 0, 100], "intensity": bright},
    }


def _cove(rng: Generator, tone: tuple[float, float, float], folds: float) -> Stage:
    """Return cloth or paper that bends up into a wall all around; ``folds`` darken it."""
    bend = [(COVE + RISE * np.sin(a), RISE * (1 - np.cos(a))) for a in np.linspace(1.57, 0, 12)]
    mesh = lathe([(COVE + RISE, WALL), *bend, (0, 0)], 48, smooth=True)
    flat = mesh.vertices[:, :2] / (2 * (COVE + RISE)) + 0.5
    ways = noise(rng, 512, 512, 90)
    weave = rng.standard_normal((512, 512)).astype(np.float32)
    shade = 1 + folds * ways + 0.4 * folds * weave
    image = np.clip(shade[..., None] * np.array(tone), 0, 255).astype(np.uint8)
    stage = Stage()
    cloth = Material(image, 0.9, specular=0.3)
    stage.add(Mesh(mesh.vertices, mesh.normals, flat, mesh.faces), cloth, own=False)
    return stage


def _table(rng: Generator) -> Stage:
    """Return a bare table of boards in an empty room of one colour."""
    stage = Stage()
    tone = rng.uniform((95, 65, 40), (215, 175, 130))
    image = textures.wood(rng, 1100, 800, (tone[0], tone[1], tone[2]), int(rng.integers(2, 7)))
    stage.add(quad(150, 110).at(z=0.0), Material(image, 0.45), own=False)
    stage.add(box(150, 110, 3, 0.2).at(z=-3.01), plain("6a4c30", 0.5), own=False)
    _walls(stage, rng)
    return stage


def _walls(stage: Stage, rng: Generator) -> None:
    r, g, b = (int(v) for v in rng.uniform(90, 215) + rng.normal(0, 12, 3))
    paint = Material((min(r, 235), min(g, 235), min(b, 235)), 0.9)
    for turn in (0, 90, 180, 270):
        inner = quad(2 * ROOM, 230).turned(x=90).at(y=ROOM, z=FLOOR + 115).turned(z=turn)
        stage.add(inner, paint, own=False)
    stage.add(quad(2 * ROOM, 2 * ROOM).at(z=FLOOR), plain("57493c", 0.8), own=False)


def _turntable(rng: Generator, angle: float) -> Ground:
    """Return a plate on a table before a wall with posters, and things that stand beside it."""
    stage, plate = _table(rng), Stage()
    furniture.wall(rng, 2 * ROOM, 215).place(stage, pose(0, ROOM - 60, FLOOR), own=False)
    for make, x, y in (
        (clutter.magazine, -34, 12),
        (clutter.page, 30, 8),
        (clutter.tape, -27, -6),
        (furniture.mug, 33, 30),
        (furniture.book_pile, -36, 36),
        (clutter.parts_box, 24, -14),
    ):
        item, turn = make(rng), rotation(z=float(rng.uniform(0, 360)))
        item.group.place(stage, pose(x, y, 0.02, turn), own=False)
    plate.add(cylinder(PLATE, PLATE_HEIGHT, 0.1, 64), plain("2e3033", 0.5), own=False)
    light = room_light(float(rng.uniform(0.9, 1.1)), angle)
    return Ground(stage, light, PLATE_HEIGHT, follows=True, turning=plate)
