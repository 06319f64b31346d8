"""Render a capture: photos, exact masks, exact cameras, id maps of small structures.

What lies in the folder afterwards::

    images/0000.jpg … masks/0000.jpg.png … ids/0000.jpg.png (test views) transforms.json object.json

``transforms.json`` is nerfstudio's form: OpenGL camera-to-world matrices, one pinhole, lengths in
centimetres. Masks are 8-bit, 255 where the object covers at least half of the pixel.
``object.json`` holds points known to lie on the object, and how the capture was made.
"""

import json
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage

from mattgs_ops.errors import InputError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.synthetic import cameras
from mattgs_ops.synthetic.denoise import denoise
from mattgs_ops.synthetic.surfaces.materials import Part, Stage
from mattgs_ops.synthetic.surfaces.mesh import Array
from mattgs_ops.synthetic.surroundings.desk import furnish
from mattgs_ops.synthetic.tracer import Layers, Tracer, choose_variant, room_light

NAMES = ("rover", "hexapod", "lattepanda", "desk_extra")
SAMPLES = 6  # light paths per pixel; with the noise filter as good as some hundreds without
TEST_EVERY = 8
EXPOSURE = 1.35
EXPOSURE_SPREAD = 0.05  # standard deviation of the exposure from photo to photo
QUALITY = 92
COVERED = 0.5  # share of a pixel from which on it is the object's
PALETTE = {Part.REST: (0, 0, 0), Part.SCREW: (230, 60, 50), Part.WIRE: (60, 120, 240)}
PALETTE |= {Part.PRINT: (250, 220, 80)}


@dataclass(frozen=True)
class World:
    """A built scene: its stage, the walk around it, the window's direction and the light."""

    stage: Stage
    poses: list[Array]
    exposures: Array
    window: float
    strength: float

    def light(self) -> dict[str, object]:
        """Return the light for the tracer."""
        return room_light(self.strength, self.window)


def build_world(name: str, views: int, seed: int) -> World:
    """Build a scene from its seed; raises :class:`InputError` for unknown names."""
    if name not in NAMES:
        raise InputError(f"capture {name!r}: expected one of {', '.join(NAMES)}")
    module: ModuleType = import_module(f"mattgs_ops.synthetic.objects.{name}")
    # one stream each, so that another number of views leaves the desk as it is
    key = NAMES.index(name)
    desk, thing, walk = (np.random.default_rng([seed, key, k]) for k in range(3))
    stage = Stage()
    ground = furnish(stage, desk, module.LAYOUT)
    module.build(stage, thing, ground)
    poses = cameras.walk(module.ORBITS, module.TARGET, views, walk)
    exposures = EXPOSURE * np.exp(walk.normal(0, EXPOSURE_SPREAD, views))
    return World(stage, poses, exposures, module.WINDOW, module.LIGHT)


def render_capture(
    name: str,
    out: Path,
    *,
    views: int = 48,
    width: int = 640,
    height: int = 480,
    samples: int = SAMPLES,
    seed: int = 0,
    variant: str | None = None,
    progress: Progress = no_progress,
) -> None:
    """Render a capture into ``out``, which is made and may not hold another one.

    ``variant`` is Mitsuba's, by default the fastest that runs here; it is written into
    ``object.json``. Raises :class:`InputError` for bad arguments, :class:`StageError` without
    Mitsuba.
    """
    if min(views, width, height, samples) < 1:
        raise InputError("views, resolution and samples: expected positive numbers")
    if (out / "transforms.json").exists():
        raise InputError(f"{out}: expected a folder without a capture, found transforms.json")
    used = choose_variant(variant)
    progress(0, views, f"building {name}")
    world = build_world(name, views, seed)
    tracer = Tracer(world.stage, world.light())
    for folder in ("images", "masks", "ids"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    frames = []
    for k, (camera, exposure) in enumerate(zip(world.poses, world.exposures, strict=True)):
        file = f"{k:04d}.jpg"
        photo = photograph(tracer, camera, width, height, samples, seed * 10_007 + k, exposure)
        layers = tracer.layers(camera, width, height)
        PilImage.fromarray(photo).save(out / "images" / file, quality=QUALITY)
        save_mask(layers, out / "masks" / f"{file}.png")
        if k % TEST_EVERY == 0:
            _save_ids(layers, out / "ids" / f"{file}.png")
        frames.append(
            {
                "file_path": f"images/{file}",
                "mask_path": f"masks/{file}.png",
                "transform_matrix": camera.tolist(),
            }
        )
        progress(k + 1, views, f"{file}, {used}")
    made = {"name": name, "seed": seed, "samples": samples, "views": views, "variant": used}
    _save_object(world, made, out / "object.json")
    save_transforms(frames, width, height, out / "transforms.json")


def photograph(
    tracer: Tracer,
    camera: Array,
    width: int,
    height: int,
    samples: int,
    seed: int,
    exposure: float,
) -> NDArray[np.uint8]:
    """Return one view as a photo, [H, W, 3] uint8 sRGB."""
    traced = tracer.render(camera, width, height, samples, seed)
    clean = denoise(traced["light"], traced["albedo"], traced["normal"], traced["depth"])
    return develop(clean, exposure)


def develop(light: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """Turn linear light into sRGB; highlights roll off as ``1 - exp(-exposure * light)``."""
    linear = 1 - np.exp(-exposure * np.maximum(light, 0))
    # IEC 61966-2-1
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    photo: NDArray[np.uint8] = np.rint(255 * np.clip(srgb, 0, 1)).astype(np.uint8)
    return photo


def save_mask(layers: Layers, path: Path) -> None:
    """Write a view's mask, 255 where the object covers at least half of the pixel."""
    mask = np.where(layers.coverage >= COVERED, 255, 0).astype(np.uint8)
    PilImage.fromarray(mask).save(path, optimize=True)


def _save_ids(layers: Layers, path: Path) -> None:
    image = PilImage.fromarray(layers.part)  # as grey values; the palette makes them indices
    colours = [channel for part in Part for channel in PALETTE[part]]
    image.putpalette(colours)
    image.save(path, optimize=True)


def _save_object(world: World, made: dict[str, object], path: Path) -> None:
    corners = np.concatenate(world.stage.corners)
    data = {**made, "unit": "centimetre", "corners": np.round(corners, 5).tolist()}
    path.write_text(json.dumps(data) + "\n", encoding="utf-8")


def save_transforms(frames: list[dict[str, object]], width: int, height: int, path: Path) -> None:
    """Write nerfstudio's ``transforms.json`` of one pinhole."""
    pinhole = cameras.intrinsics(width, height)
    data = {
        "camera_model": "PINHOLE",
        "w": width,
        "h": height,
        "fl_x": pinhole.fx,
        "fl_y": pinhole.fy,
        "cx": pinhole.cx,
        "cy": pinhole.cy,
        "frames": frames,
    }
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
