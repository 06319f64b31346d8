"""Path-traced training images: random objects of ``things`` on synthetic desks and plain grounds.

The painter of ``draw`` is fast and endless, but a network could learn to tell paint from light
instead of object from desk. So some views are traced as the benchmark's captures and evaluation
sets are: other desks and grounds (other seeds), random objects, never one of theirs. Needs Mitsuba
(the ``dev`` extra).

``render_places`` writes a folder::

    images/NAME.png  masks/NAME.png     views with an object, and its exact mask
    empty/NAME.png   empty/cameras.json views without, to paint objects on
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.network.train_config import RenderedConfig
from mattgs_ops.segment.training_images.solids import Face, Paint
from mattgs_ops.segment.training_images.textures import Bank
from mattgs_ops.segment.training_images.things import OBJECTS

if TYPE_CHECKING:  # Mitsuba is an extra
    from mattgs_ops.synthetic.surroundings.grounds import Ground
    from mattgs_ops.synthetic.tracer import Tracer

SAMPLES = 6  # per pixel, the rest of the noise is filtered away
PLAIN = ("black-cloth", "white-sweep", "wooden-table", "dark-flash")
LIFT = 0.03  # centimetres that paint on a face floats above it
CLEAR, REACH = 15.0, 50.0  # centimetres: free radius on the desk, distance of the nearest cameras
NEAREST = 22.0  # centimetres from the eye to the middle of the object
SPAN = (0.45, 0.96)  # share of the frame that a photographer gives the object


def render_places(config: RenderedConfig, out: Path, *, progress: Progress = no_progress) -> None:
    """Trace all places that are not there yet; a killed run goes on with the next one.

    Raises :class:`InputError` when Mitsuba is not installed.
    """
    try:
        from mattgs_ops.synthetic import tracer

        tracer.choose_variant()
    except ImportError as error:
        raise InputError(
            "rendered: expected Mitsuba to trace training views (install the `dev` extra), "
            f"found: {error}"
        ) from error
    for folder in ("images", "masks", "empty"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    places = config.desks + config.plain
    for place in range(places):
        done = out / f"place{place:02d}.json"
        if not done.is_file():
            cameras = _place(config, place, out)
            done.write_text(json.dumps(cameras), encoding="utf-8")
        progress(place + 1, places, "places rendered")


def _place(config: RenderedConfig, place: int, out: Path) -> dict[str, Any]:
    """Build a place, trace it empty and with ``objects`` objects one after another."""
    from mattgs_ops.synthetic.surfaces.materials import Stage
    from mattgs_ops.synthetic.tracer import Tracer

    rng = np.random.default_rng((config.seed, place))
    bank = Bank(config.seed + place)
    ground, size = _ground(config, place, rng), (config.width, config.width * 3 // 4)
    cameras: dict[str, Any] = {}
    for k in range(config.objects + 1):
        stage = Stage({key: list(meshes) for key, meshes in ground.stage.pieces.items()})
        points = None
        if k:
            thing = OBJECTS[(place * config.objects + k) % len(OBJECTS)](rng, Paint.random(rng))
            scale = float(rng.uniform(10, 14))
            corners = np.concatenate([face.contours[0] for face in thing])
            points = scale * corners + [0, 0, ground.top]
            _put(stage, thing, ground.top, scale, bank, rng)
        scene = Tracer(stage, ground.light)
        count = config.views if k else config.empty
        for view in range(count):
            name = f"{place:02d}_{k:02d}_{view:02d}.png"
            pose = _orbit(rng, ground.top, view, count)
            if points is not None:
                pose = _framed(rng, pose, points, size)
            image = _traced(scene, pose, ground, size, rng)
            folder = out / ("images" if k else "empty")
            cv2.imwrite(str(folder / name), image[..., ::-1])
            if k:
                coverage = scene.layers(pose, *size).coverage
                mask = np.rint(coverage * 255).astype(np.uint8)
                cv2.imwrite(str(out / "masks" / name), mask)
            else:
                cameras[name] = {"top": ground.top, "pose": pose.tolist()}
    return cameras


def _ground(config: RenderedConfig, place: int, rng: np.random.Generator) -> "Ground":
    """Lay a desk, every second one with a mat under the object, or a plain ground after them."""
    from mattgs_ops.synthetic.surroundings import clutter
    from mattgs_ops.synthetic.surroundings.desk import Layout
    from mattgs_ops.synthetic.surroundings.grounds import lay

    if place >= config.desks:
        return lay(PLAIN[(place - config.desks) % len(PLAIN)], rng)
    r, g, b = (int(v) for v in rng.uniform((110, 80, 60), (215, 190, 160)))
    under = ((clutter.mat, *rng.normal(0, 3, 2), rng.uniform(0, 90)),) if place % 2 else ()
    return lay("cluttered-desk", rng, Layout(CLEAR, REACH, (r, g, b), under))


def _orbit(rng: np.random.Generator, top: float, view: int, count: int) -> NDArray[np.float64]:
    from mattgs_ops.synthetic import cameras

    azimuth = 2 * np.pi * (view + rng.uniform(0, 1)) / count
    elevation = np.radians(rng.uniform(10, 62))
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
    from mattgs_ops.synthetic.surroundings.grounds import FLASH

    if ground.flash:
        scene.move_lamp(FLASH, pose[:3, 3] + rng.uniform(3, 9) * pose[:3, 1])
    exposure = EXPOSURE * float(np.exp(ground.spread * rng.normal()))
    seed = int(rng.integers(1 << 30))
    return photograph(scene, pose, *size, SAMPLES, seed, exposure)


def _put(
    stage: Any,
    thing: Sequence[Face],
    top: float,
    scale: float,
    bank: Bank,
    rng: np.random.Generator,
) -> None:
    """Put faces on the stage as the object, ``scale`` centimetres to the unit, at ``top``."""
    from mattgs_ops.synthetic.surfaces.materials import Material

    materials: dict[tuple[tuple[float, float, float], str], Any] = {}
    for face in thing:
        key = (face.colour, face.use)
        if key not in materials:
            rough, metal = float(rng.uniform(0.15, 0.8)), float(rng.random() < 0.25)
            rgb = tuple(int(255 * c) for c in face.colour)
            if face.use:
                share = bank.pick(rng, face.use)[..., None].astype(np.float32) / 255
                other = np.array(rgb) * rng.uniform(0.2, 0.8)
                skin = (share * np.array(rgb) + (1 - share) * other).astype(np.uint8)
                materials[key] = Material(skin, rough)
            else:
                materials[key] = Material((rgb[0], rgb[1], rgb[2]), rough, metal)
        for mesh in _meshes(face, scale, top):
            stage.add(mesh, materials[key], own=True)


def _meshes(face: Face, scale: float, top: float) -> list[Any]:
    """One fan of triangles, or two back to back where the face is seen from both sides."""
    from mattgs_ops.synthetic.surfaces.mesh import Mesh

    points = face.contours[0] * scale + [0, 0, top]
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        return []
    normal /= length
    fan = np.array([[0, i, i + 1] for i in range(1, len(points) - 1)])
    edge = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    plane = (points - points[0]) @ np.stack([edge, np.cross(normal, edge)], 1)
    uvs = (plane - plane.min(0)) / np.maximum(np.ptp(plane, axis=0).max(), 1e-9)
    sides = (1.0, -1.0) if not face.normal.any() else (1.0 if face.normal @ normal > 0 else -1.0,)
    meshes = []
    for side in sides:
        lift = LIFT if face.decal or len(sides) == 2 else 0.0
        placed = points + side * lift * normal
        normals = np.tile(side * normal, (len(points), 1))
        meshes.append(Mesh(placed, normals, uvs, fan if side > 0 else fan[:, ::-1]))
    return meshes
