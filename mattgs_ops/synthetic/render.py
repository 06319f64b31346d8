"""Render a capture: photos, exact masks, exact cameras, id maps of small structures.

What lies in the folder afterwards::

    images/0000.jpg … images/test_0000.jpg … masks/0000.jpg.png … ids/test_0000.jpg.png …
    transforms.json object.json

Training photos are what a phone would give: exposures vary, and JPEG is as a camera sets it. Test
photos come from a walk of their own; none of them is a training photo. They are the truth that
renders are compared with, so they have more light paths, one exposure and nearly no JPEG loss.

``transforms.json`` is nerfstudio's form: OpenGL camera-to-world matrices, one pinhole, lengths in
centimetres, and the split by ``train_filenames`` and ``test_filenames``. Masks hold the share of
the pixel that the object covers, 0 to 255. ``object.json`` holds points known to lie on the object,
and how the capture was made. A view follows from its name and the seed alone: a killed rendering
goes on with the next view.
"""

import json
from dataclasses import asdict, dataclass
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
from mattgs_ops.synthetic.made_file import check_same, write_made
from mattgs_ops.synthetic.surfaces.materials import Part, Stage
from mattgs_ops.synthetic.surfaces.mesh import Array
from mattgs_ops.synthetic.surroundings.desk import furnish
from mattgs_ops.synthetic.tracer import Layers, Tracer, choose_variant, room_light
from mattgs_ops.whole_file import write_text_whole, written_whole

NAMES = ("rover", "hexapod", "lattepanda", "desk_extra")
# light paths per pixel of training and test photos (measured: benchmarks/captures/photo_noise.py)
SAMPLES, TEST_SAMPLES = 8, 64
EXPOSURE = 1.35
EXPOSURE_SPREAD = 0.05  # standard deviation of the exposure from training photo to training photo
QUALITY = 90  # JPEG, colours at half resolution: a phone's
TEST_QUALITY = 97  # JPEG, colours at full resolution
TEST_SEED = 5_003  # apart from the seeds of a walk's training views
STREAMS = ("desk", "object", "walk", "test walk")  # of random numbers; the order counts
PALETTE = {Part.REST: (0, 0, 0), Part.SCREW: (230, 60, 50), Part.WIRE: (60, 120, 240)}
PALETTE |= {Part.PRINT: (250, 220, 80)}


@dataclass(frozen=True)
class Making:
    """How a capture is made; written into ``object.json``."""

    name: str
    seed: int = 0
    views: int = 48
    test_views: int = 24
    width: int = 800
    height: int = 600
    samples: int = SAMPLES
    test_samples: int = TEST_SAMPLES

    def __post_init__(self) -> None:
        """Raise :class:`InputError` for unknown names and numbers that are too small."""
        if self.name not in NAMES:
            raise InputError(f"capture {self.name!r}: expected one of {', '.join(NAMES)}")
        for field in ("views", "width", "height", "samples", "test_samples"):
            if getattr(self, field) < 1:
                raise InputError(
                    f"{field}: expected a positive number, found {getattr(self, field)}"
                )
        for field in ("seed", "test_views"):
            if getattr(self, field) < 0:
                raise InputError(
                    f"{field}: expected no negative number, found {getattr(self, field)}"
                )


@dataclass(frozen=True)
class View:
    """One photo to take: its file's name, camera [4, 4] (OpenGL), exposure, paths and seed."""

    file: str
    pose: Array
    exposure: float
    samples: int
    seed: int
    test: bool


@dataclass(frozen=True)
class World:
    """A built scene: its stage, the window's direction, the light and the views."""

    stage: Stage
    window: float
    strength: float
    views: list[View]

    def light(self) -> dict[str, object]:
        """Return the light for the tracer."""
        return room_light(self.strength, self.window)


def build_world(making: Making) -> World:
    """Build a scene from its seed: object, desk, and the walks of training and test views."""
    module = _module(making)
    stage = Stage()
    ground = furnish(stage, _stream(making, "desk"), module.LAYOUT)
    module.build(stage, _stream(making, "object"), ground)
    return World(stage, module.WINDOW, module.LIGHT, plan_views(making))


def plan_views(making: Making) -> list[View]:
    """Return the photos to take, training views first; nothing is built for it."""
    module, walk = _module(making), _stream(making, "walk")
    poses = cameras.walk(module.ORBITS, module.TARGET, making.views, walk)
    exposures = EXPOSURE * np.exp(walk.normal(0, EXPOSURE_SPREAD, making.views))
    first = making.seed * 10_007
    views = [
        View(f"{k:04d}.jpg", pose, float(exposure), making.samples, first + k, test=False)
        for k, (pose, exposure) in enumerate(zip(poses, exposures, strict=True))
    ]
    test_walk = _stream(making, "test walk")
    test_poses = cameras.walk(module.ORBITS, module.TARGET, making.test_views, test_walk)
    views += [
        View(f"test_{k:04d}.jpg", pose, EXPOSURE, making.test_samples, first + TEST_SEED + k, True)
        for k, pose in enumerate(test_poses)
    ]
    return views


def _module(making: Making) -> ModuleType:
    return import_module(f"mattgs_ops.synthetic.objects.{making.name}")


def _stream(making: Making, what: str) -> np.random.Generator:
    """Return a stream of its own, so that another number of views leaves the desk as it is."""
    seeds = [making.seed, NAMES.index(making.name), STREAMS.index(what)]
    return np.random.default_rng(seeds)


def render_capture(
    making: Making, out: Path, *, variant: str | None = None, progress: Progress = no_progress
) -> None:
    """Render a capture into ``out``; views that are there from an interrupted call are kept.

    ``variant`` is Mitsuba's, by default the fastest that runs here; it is written into
    ``object.json``. Raises :class:`InputError` for a folder that holds a finished capture or one
    that was made otherwise, :class:`StageError` without Mitsuba.
    """
    if (out / "transforms.json").exists():
        raise InputError(f"{out}: expected a folder without a capture, found transforms.json")
    used = choose_variant(variant)
    total = making.views + making.test_views
    made = {**asdict(making), "variant": used}
    check_same(out / "object.json", made, "a capture")
    progress(0, total, f"building {making.name}")
    world = build_world(making)
    _begin(world, made, out)
    tracer = Tracer(world.stage, world.light())
    for k, view in enumerate(world.views):
        if not mask_path(out, view).exists():  # written last
            _render_view(tracer, view, making, out)
        progress(k + 1, total, f"{view.file}, {used}")
    frames: list[dict[str, object]] = [
        {
            "file_path": f"images/{view.file}",
            "mask_path": f"masks/{view.file}.png",
            "transform_matrix": view.pose.tolist(),
        }
        for view in world.views
    ]
    names = {
        split: [f"images/{view.file}" for view in world.views if view.test == (split == "test")]
        for split in ("train", "test")
    }
    split = {f"{key}_filenames": files for key, files in names.items()} if names["test"] else {}
    save_transforms(frames, making.width, making.height, out / "transforms.json", split)


def mask_path(out: Path, view: View) -> Path:
    """Return where a view's mask lies."""
    return out / "masks" / f"{view.file}.png"


def _begin(world: World, made: dict[str, object], out: Path) -> None:
    """Make the folders and ``object.json``."""
    for folder in ("images", "masks", "ids"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    corners = np.concatenate(world.stage.corners)
    data = {**made, "unit": "centimetre", "corners": np.round(corners, 5).tolist()}
    write_made(out / "object.json", data)


def _render_view(tracer: Tracer, view: View, making: Making, out: Path) -> None:
    size = making.width, making.height
    photo = photograph(tracer, view.pose, *size, view.samples, view.seed, view.exposure)
    layers = tracer.layers(view.pose, *size)
    quality, subsampling = (TEST_QUALITY, "4:4:4") if view.test else (QUALITY, "4:2:0")
    # progressive with tables of its own: the same pixels in 7 % fewer bytes
    PilImage.fromarray(photo).save(
        out / "images" / view.file,
        quality=quality,
        subsampling=subsampling,
        optimize=True,
        progressive=True,
    )
    if view.test:
        _save_ids(layers, out / "ids" / f"{view.file}.png")
    save_mask(layers, mask_path(out, view))


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
    clean = denoise(traced["light"], traced["albedo"], traced["normal"])
    return develop(clean, exposure)


def develop(light: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """Turn linear light into sRGB; highlights roll off as ``1 - exp(-exposure * light)``."""
    linear = 1 - np.exp(-exposure * np.maximum(light, 0))
    # IEC 61966-2-1
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    photo: NDArray[np.uint8] = np.rint(255 * np.clip(srgb, 0, 1)).astype(np.uint8)
    return photo


def save_mask(layers: Layers, path: Path) -> None:
    """Write a view's mask: the share of each pixel that the object covers, 0 to 255.

    The file appears whole or not at all.
    """
    mask = np.rint(255 * layers.coverage).astype(np.uint8)
    with written_whole(path) as partial:
        PilImage.fromarray(mask).save(partial, format="PNG", optimize=True)


def _save_ids(layers: Layers, path: Path) -> None:
    image = PilImage.fromarray(layers.part)  # as grey values; the palette makes them indices
    colours = [channel for part in Part for channel in PALETTE[part]]
    image.putpalette(colours)
    image.save(path, optimize=True)


def save_transforms(
    frames: list[dict[str, object]],
    width: int,
    height: int,
    path: Path,
    split: dict[str, list[str]] | None = None,
) -> None:
    """Write nerfstudio's ``transforms.json`` of one pinhole, with lists of files of a ``split``.

    The file appears whole or not at all.
    """
    pinhole = cameras.intrinsics(width, height)
    data = {
        "camera_model": "PINHOLE",
        "w": width,
        "h": height,
        "fl_x": pinhole.fx,
        "fl_y": pinhole.fy,
        "cx": pinhole.cx,
        "cy": pinhole.cy,
        **(split or {}),
        "frames": frames,
    }
    write_text_whole(path, json.dumps(data, indent=1) + "\n")
