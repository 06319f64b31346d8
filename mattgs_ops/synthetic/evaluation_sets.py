"""Evaluation sets: objects on grounds, to see where masks fail, and six sets that only judge.

    mattgs captures evaluation OUT [--sets rover-black-cloth,figurine-turntable] [--views 24]

``OUT/OBJECT-GROUND/`` is a capture as the bundled ones are: photos, exact masks and cameras of one
walk of 48 views. With fewer ``--views`` every second or fourth of them is rendered, and a later
call adds the rest: a view follows from its number and the seed alone. A set that is there is left
as it is; a killed run goes on with the next view. Nothing here is ever trained on. No bound and no
rule of the pipeline was chosen on :data:`JUDGING_SETS`: they say what the choices are worth.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
from PIL import Image as PilImage

from mattgs_ops.errors import InputError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.synthetic import cameras
from mattgs_ops.synthetic.made_file import FILE, check_same, write_made
from mattgs_ops.synthetic.render import (
    EXPOSURE,
    QUALITY,
    photograph,
    save_mask,
    save_transforms,
)
from mattgs_ops.synthetic.surfaces.materials import Stage
from mattgs_ops.synthetic.surfaces.mesh import Array, rotation
from mattgs_ops.synthetic.surroundings.grounds import FLASH, GROUNDS, Ground, lay
from mattgs_ops.synthetic.tracer import Tracer, choose_variant

OBJECTS = {  # name: module
    "rover": "rover",
    "crane": "desk_extra",
    "figurine": "figurine",
    "temple": "temple",
    "stone": "stone",
    "trunk": "trunk",
}
CHOOSING_OBJECTS = ("rover", "crane", "figurine")
CHOOSING_GROUNDS = tuple(name for name in GROUNDS if name != "woods")
WALK = 48  # views of a whole set
COUNTS = (48, 24, 12)
WIDTH, HEIGHT, SAMPLES = 400, 300, 12
SEED = 77_000  # of its own: neither the captures' nor the training images'
LOW, HIGH = 14.0, 44.0  # degrees of elevation that the walk swings between
SWINGS = 2  # times it goes up and down: fewer views are as even as all of them
LAMP_ABOVE = 4.0  # centimetres from the lens to the flash


@dataclass(frozen=True)
class EvaluationSet:
    """One object on one ground, named ``OBJECT-GROUND``."""

    thing: str
    ground: str

    @property
    def name(self) -> str:
        """Return the folder's name."""
        return f"{self.thing}-{self.ground}"

    @property
    def seeds(self) -> list[int]:
        """Return what the set's generators are seeded with."""
        return [SEED, list(OBJECTS).index(self.thing), GROUNDS.index(self.ground)]


CHOOSING_SETS = (
    *(EvaluationSet(thing, ground) for ground in CHOOSING_GROUNDS for thing in CHOOSING_OBJECTS),
    # judged once, and showed what two rules were missing
    EvaluationSet("stone", "cluttered-desk"),
    EvaluationSet("trunk", "woods"),
    # looked at when the limits of a plain ground's correction were chosen
    EvaluationSet("temple", "black-cloth"),
    EvaluationSet("temple", "white-sweep"),
    EvaluationSet("stone", "dark-flash"),
    EvaluationSet("figurine", "woods"),
    # looked at when it was chosen how sure the outline's network has to be
    EvaluationSet("temple", "dark-flash"),
    EvaluationSet("stone", "white-sweep"),
    # looked at when it was chosen how votes correct maps that make the masks
    EvaluationSet("stone", "woods"),
    EvaluationSet("stone", "black-cloth"),
)
JUDGING_SETS = (
    EvaluationSet("temple", "cluttered-desk"),
    EvaluationSet("temple", "wooden-table"),
    EvaluationSet("temple", "woods"),
    EvaluationSet("stone", "wooden-table"),
    EvaluationSet("stone", "turntable"),
    EvaluationSet("temple", "turntable"),
)
SETS = CHOOSING_SETS + JUDGING_SETS
NAMES = tuple(one.name for one in SETS)


def render_sets(
    out: Path,
    names: Sequence[str] = NAMES,
    *,
    views: int = WALK,
    width: int = WIDTH,
    height: int = HEIGHT,
    samples: int = SAMPLES,
    variant: str | None = None,
    progress: Progress = no_progress,
) -> None:
    """Render the named sets into ``out``, each view that is not there yet.

    Raises :class:`InputError` for unknown names and numbers of views, and for a set that was
    rendered at another size; :class:`StageError` without Mitsuba.
    """
    known = dict(zip(NAMES, SETS, strict=True))
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(f"sets: expected some of {', '.join(known)}, found {', '.join(unknown)}")
    if views not in COUNTS:
        raise InputError(f"views: expected one of {', '.join(map(str, COUNTS))}, found {views}")
    used = choose_variant(variant)
    made = {"width": width, "height": height, "samples": samples, "variant": used}
    for k, name in enumerate(names):
        progress(k, len(names), name)
        _render_set(known[name], out / name, views, made)
    progress(len(names), len(names), "sets rendered")


def _render_set(one: EvaluationSet, out: Path, views: int, made: dict[str, object]) -> None:
    """Render one set; its listing is written last and names the views that are there."""
    check_same(out / FILE, made, "a set")
    step = WALK // views
    wanted = [k for k in range(0, WALK, step) if not (out / "masks" / f"{k:04d}.jpg.png").exists()]
    poses, exposures = walk(one)
    if wanted:
        for folder in ("images", "masks"):
            (out / folder).mkdir(parents=True, exist_ok=True)
        write_made(out / FILE, made)
        shown = _TracedSet(one)
        for k in wanted:
            _render_view(shown, poses[k], exposures[k], k, out, made)
    there = [k for k in range(WALK) if (out / "masks" / f"{k:04d}.jpg.png").exists()]
    frames = [
        {
            "file_path": f"images/{k:04d}.jpg",
            "mask_path": f"masks/{k:04d}.jpg.png",
            "transform_matrix": poses[k].tolist(),
        }
        for k in there
    ]
    save_transforms(
        frames, int(str(made["width"])), int(str(made["height"])), out / "transforms.json"
    )


def walk(one: EvaluationSet) -> tuple[list[Array], Array]:
    """Return the set's 48 camera-to-world matrices [4, 4] (OpenGL) and the exposures [48]."""
    module = _module(one)
    rng = np.random.default_rng([*one.seeds, 2])
    start = rng.uniform(0, 2 * np.pi)
    poses = []
    for k in range(WALK):
        around = start + 2 * np.pi * k / WALK
        rise = (LOW + HIGH) / 2 + (HIGH - LOW) / 2 * np.sin(SWINGS * (around - start))
        rise = np.radians(rise + rng.normal(0, 1.5))
        around += np.radians(rng.normal(0, 1.0))
        far = module.ORBITS[0].distance * (1 + np.clip(rng.normal(0, 0.04), -0.08, 0.08))
        ray = [np.cos(around) * np.cos(rise), np.sin(around) * np.cos(rise), np.sin(rise)]
        aim = module.TARGET + np.clip(rng.normal(0, 0.015, 3), -0.03, 0.03) * far
        eye = module.TARGET + far * np.array(ray)
        poses.append(cameras.look_at(eye, aim, float(rng.normal(0, 2))))
    return poses, rng.normal(0, 1, WALK)


def _module(one: EvaluationSet) -> ModuleType:
    return import_module(f"mattgs_ops.synthetic.objects.{OBJECTS[one.thing]}")


class _TracedSet:
    """A set's object on its ground, ready to be traced from a camera."""

    def __init__(self, one: EvaluationSet) -> None:
        module = _module(one)
        rng, thing = (np.random.default_rng([*one.seeds, k]) for k in range(2))
        self.ground: Ground = lay(one.ground, rng, module.LAYOUT)
        self.turning = self.ground.turning
        module.build(self.turning, thing, self.ground.top)
        self._still: Tracer | None = None

    def tracer(self, pose: Array) -> Tracer:
        """Return the tracer for a view; only what follows the camera is loaded anew."""
        if self._still is None or self.ground.follows:
            around = float(np.degrees(np.arctan2(pose[1, 3], pose[0, 3]))) + 90
            turn = around if self.ground.follows else 0.0
            stage = Stage()
            for source, matrix in (
                (self.ground.stage, rotation(z=turn)),
                (self.turning, np.eye(4)),
            ):
                for (material, part, own), meshes in source.pieces.items():
                    for mesh in meshes:
                        stage.add(mesh.transformed(matrix), material, part, own=own)
            self._still = Tracer(stage, self.ground.light, self._still)
        if self.ground.flash:
            self._still.move_lamp(FLASH, pose[:3, 3] + LAMP_ABOVE * pose[:3, 1])
        return self._still


def _render_view(
    shown: _TracedSet, pose: Array, stray: float, k: int, out: Path, made: dict[str, object]
) -> None:
    width, height, samples = (int(str(made[key])) for key in ("width", "height", "samples"))
    tracer = shown.tracer(pose)
    exposure = EXPOSURE * float(np.exp(shown.ground.spread * stray))
    photo = photograph(tracer, pose, width, height, samples, SEED + k, exposure)
    layers = tracer.layers(pose, width, height)
    PilImage.fromarray(photo).save(out / "images" / f"{k:04d}.jpg", quality=QUALITY)
    save_mask(layers, out / "masks" / f"{k:04d}.jpg.png")
