"""Path-traced training images: random objects on synthetic desks and plain grounds.

The painter of ``draw`` is fast and endless, but a network could learn to tell paint from light
instead of object from desk. So some views are traced as the benchmark's captures and evaluation
sets are: other desks and grounds (other seeds), random objects, never one of theirs. Needs Mitsuba
(the ``dev`` extra).

``render_places`` writes a folder::

    images/NAME.jpg  masks/NAME.png  views with an object, and its exact mask
    empty/NAME.jpg   placeNN.json    views without, to paint objects on, and their cameras
    made.json                        the configuration, as far as it decides what is traced
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.network.train_config import RenderedConfig
from mattgs_ops.segment.training_images.figure_families import random_figure
from mattgs_ops.segment.training_images.solids import Array, Paint
from mattgs_ops.segment.training_images.textures import Bank
from mattgs_ops.segment.training_images.things import OBJECTS
from mattgs_ops.segment.training_images.traced.objects import put_figure, put_thing
from mattgs_ops.segment.training_images.traced.rooms import Room, lay_room, put_random
from mattgs_ops.synthetic.made_file import FILE, check_folder, write_made
from mattgs_ops.synthetic.tracer import GRID
from mattgs_ops.whole_file import write_text_whole

if TYPE_CHECKING:  # Mitsuba is an extra
    from collections.abc import Callable

    from mattgs_ops.synthetic.surroundings.grounds import Ground
    from mattgs_ops.synthetic.surroundings.item import Item
    from mattgs_ops.synthetic.tracer import Tracer

SAMPLES = 6  # per pixel, the rest of the noise is filtered away
PLAIN = ("black-cloth", "white-sweep", "wooden-table", "dark-flash", "turntable", "woods")
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 90]  # a third of PNG; augmentation spoils them further
UNDER_SHARE = 0.6  # of desks on which sheets lie under the object
CLEAR, REACH = 15.0, 50.0  # centimetres: free radius on the desk, distance of the nearest cameras
NEAREST = 22.0  # centimetres from the eye to the middle of the object
SCALE = (10, 14)  # centimetres to an object's unit
LOWEST, HIGHEST = 10, 62  # degrees of elevation
ROOM_GRID = 3  # samples per pixel and direction of a room's mask; the tracer's own for the rest
MIDRIFF = 6.0  # centimetres above its foot that an object is focused at
MIDDLE = (0.06, 0.45)  # linear brightness that a camera gives the middle of what it measures
SEEN = 0.005  # of a photo: an object that covers less is hidden by something, the view is dropped
MIXING = {"share", "backdrops", "pasted"}  # settings of how the views are used, not traced
SPAN = (0.45, 0.96)  # share of the frame that a photographer gives the object


def render_places(config: RenderedConfig, out: Path, *, progress: Progress = no_progress) -> None:
    """Trace all places that are not there yet; a killed run goes on with the next one.

    Raises :class:`InputError` for a folder whose places are of another configuration or tell of
    none, and when there is one to trace and Mitsuba is not installed.
    """
    made = config.model_dump(mode="json", exclude=MIXING)
    check_folder(out, made)
    places = [out / f"place{place:02d}.json" for place in range(config.places)]
    if all(done.is_file() for done in places):
        return
    try:
        from mattgs_ops.synthetic import tracer

        tracer.choose_variant()
    except (ImportError, StageError) as error:
        raise InputError(
            "rendered: expected Mitsuba to trace training views (install the `dev` extra), "
            f"found: {error}"
        ) from error
    for folder in ("images", "masks", "empty"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    write_made(out / FILE, made)
    for place, done in enumerate(places):
        if not done.is_file():
            cameras = _place(config, place, out)
            write_text_whole(done, json.dumps(cameras))
        progress(place + 1, len(places), "places rendered")


def _place(config: RenderedConfig, place: int, out: Path) -> dict[str, Any]:
    """Build a place, trace it empty and with ``objects`` objects one after another."""
    from mattgs_ops.synthetic.surfaces.materials import Stage
    from mattgs_ops.synthetic.tracer import Tracer

    rng = np.random.default_rng((config.seed, place))
    bank = Bank(config.seed + place)
    room = lay_room(rng, bank) if place >= config.desks + config.plain else None
    ground = room.ground if room else _ground(config, place, rng)
    size = (config.width, config.width * 3 // 4)
    cameras: dict[str, Any] = {}
    for k in range(config.objects + 1):
        stage = Stage({key: list(meshes) for key, meshes in ground.stage.pieces.items()})
        points = None
        if k:
            number = place * config.objects + k
            points = (
                put_random(stage, ground.top, float(rng.uniform(*SCALE)), bank, rng)
                if room
                else _put_object(config, stage, number, ground.top, bank, rng)
            )
        scene = Tracer(stage, ground.light)
        count = config.views if k else config.empty
        for view in range(count):
            name = f"{place:02d}_{k:02d}_{view:02d}"
            pose = _orbit(rng, ground.top, view, count, room.lowest if room else LOWEST)
            if points is not None:
                pose = _framed(rng, pose, points, size)
            image = (
                _traced_room(scene, pose, room, size, rng)
                if room
                else _traced(scene, pose, ground, size, rng)
            )
            if not k:
                _save_photo(image, out / "empty" / f"{name}.jpg")
                cameras[f"{name}.jpg"] = {"top": ground.top, "pose": pose.tolist()}
                continue
            coverage = scene.layers(pose, *size, ROOM_GRID if room else GRID).coverage
            if coverage.mean() >= SEEN:
                _save_photo(image, out / "images" / f"{name}.jpg")
                mask = np.rint(coverage * 255).astype(np.uint8)
                cv2.imwrite(str(out / "masks" / f"{name}.png"), mask)
    return cameras


def _save_photo(image: NDArray[np.uint8], path: Path) -> None:
    cv2.imwrite(str(path), image[..., ::-1], JPEG)


def _put_object(
    config: RenderedConfig,
    stage: Any,
    number: int,
    top: float,
    bank: Bank,
    rng: np.random.Generator,
) -> Array:
    """Put a random object on the stage; return points [K, 3] around it, centimetres."""
    scale = float(rng.uniform(*SCALE))
    if rng.random() < config.figures:
        figure = random_figure(rng)
        put_figure(stage, figure, top, scale, bank, rng)
        corners = figure.points
    else:
        thing = OBJECTS[number % len(OBJECTS)](rng, Paint.random(rng))
        put_thing(stage, thing, top, scale, bank, rng)
        corners = np.concatenate([face.contours[0] for face in thing])
    return np.asarray(scale * corners + [0, 0, top])


def _ground(config: RenderedConfig, place: int, rng: np.random.Generator) -> "Ground":
    """Lay a desk, most with sheets under the object, or a plain ground after them."""
    from mattgs_ops.synthetic.surroundings.desk import Layout
    from mattgs_ops.synthetic.surroundings.grounds import lay

    if place >= config.desks:
        ground = lay(PLAIN[(place - config.desks) % len(PLAIN)], rng)
        for key, meshes in ground.turning.pieces.items():
            ground.stage.pieces.setdefault(key, []).extend(meshes)
        return ground
    r, g, b = (int(v) for v in rng.uniform((110, 80, 60), (215, 190, 160)))
    return lay("cluttered-desk", rng, Layout(CLEAR, REACH, (r, g, b), _sheets_under(rng)))


def _sheets_under(
    rng: np.random.Generator,
) -> "tuple[tuple[Callable[[np.random.Generator], Item], float, float, float], ...]":
    """Draw what lies under the object, off its middle and turned: nothing, one sheet or two."""
    from mattgs_ops.synthetic.surroundings import clutter

    if rng.random() > UNDER_SHARE:
        return ()
    sheets = (clutter.mat, clutter.newspaper, clutter.cloth, clutter.page, clutter.magazine)
    drawn = rng.integers(len(sheets), size=int(rng.integers(1, 3)))
    return tuple(
        (sheets[i], float(rng.normal(0, 4)), float(rng.normal(0, 4)), float(rng.uniform(0, 360)))
        for i in drawn
    )


def _orbit(
    rng: np.random.Generator, top: float, view: int, count: int, lowest: float
) -> NDArray[np.float64]:
    from mattgs_ops.synthetic import cameras

    azimuth = 2 * np.pi * (view + rng.uniform(0, 1)) / count
    elevation = np.radians(rng.uniform(lowest, HIGHEST))
    distance = rng.uniform(38, 68)
    ray = [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation)]
    target = np.array([*rng.normal(0, 1.2, 2), top + rng.uniform(1, 8)])
    eye = target + distance * np.array([*ray, np.sin(elevation)])
    return cameras.look_at(eye, target, float(rng.normal(0, 3)))


def _framed(
    rng: np.random.Generator,
    pose: NDArray[np.float64],
    points: NDArray[np.float64],
    size: tuple[int, int],
) -> NDArray[np.float64]:
    """Aim at the object's middle and step nearer or farther until it fills the wanted share."""
    from mattgs_ops.synthetic import cameras

    middle = (points.min(0) + points.max(0)) / 2
    back, roll = pose[:3, 2], float(rng.normal(0, 3))
    distance, wanted = 50.0, rng.uniform(*SPAN)
    aim = middle + rng.normal(0, 0.06, 3) * np.ptp(points, axis=0).max()
    half = np.array(size) / 2
    for _ in range(6):  # the share is nearly as 1 / distance: this converges fast
        framed = cameras.look_at(aim + distance * back, aim, roll)
        pixels, _ = cameras.camera(framed, *size).project(points)
        share = float((np.abs(pixels - half) / half).max())
        distance = max(NEAREST, distance * float(np.clip(share / wanted, 0.5, 2.0)))
    return framed


def _traced(
    scene: "Tracer",
    pose: NDArray[np.float64],
    ground: "Ground",
    size: tuple[int, int],
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Trace a view as the captures are; [H, W, 3] uint8 RGB."""
    from mattgs_ops.synthetic.render import EXPOSURE, photograph

    _move_flash(scene, pose, ground, rng)
    exposure = EXPOSURE * float(np.exp(ground.spread * rng.normal()))
    seed = int(rng.integers(1 << 30))
    return photograph(scene, pose, *size, SAMPLES, seed, exposure)


def _move_flash(
    scene: "Tracer", pose: NDArray[np.float64], ground: "Ground", rng: np.random.Generator
) -> None:
    """Put the flash, where there is one, a little above the lens."""
    from mattgs_ops.synthetic.surroundings.grounds import FLASH

    if ground.flash:
        scene.move_lamp(FLASH, pose[:3, 3] + rng.uniform(3, 9) * pose[:3, 1])


def _traced_room(
    scene: "Tracer",
    pose: NDArray[np.float64],
    room: Room,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Trace a view of a room, exposed by what is seen; [H, W, 3] uint8 RGB."""
    from mattgs_ops.synthetic.denoise import denoise
    from mattgs_ops.synthetic.render import develop
    from mattgs_ops.synthetic.tracer import Lens

    _move_flash(scene, pose, room.ground, rng)
    focus = float(np.linalg.norm(pose[:3, 3] - [0, 0, room.ground.top + MIDRIFF]))
    lens = Lens(room.aperture, focus) if room.aperture else None
    traced = scene.render(pose, *size, SAMPLES, int(rng.integers(1 << 30)), lens)
    light = denoise(traced["light"], traced["albedo"], traced["normal"])
    measured = float(np.median(light.mean(axis=2)))
    wanted = float(np.exp(rng.uniform(*np.log(MIDDLE))))
    return develop(light, -np.log(1 - wanted) / max(measured, 1e-4))
