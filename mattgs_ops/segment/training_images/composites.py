"""Training images made on the fly: one salient object over a cluttered scene, and its exact mask.

A sample is drawn by a small painter's-algorithm renderer: a desk with sheets and clutter in
perspective, the object standing in the middle, cast shadows, directional light with gloss. Every
sample follows from ``(seed, index)``; a camera's faults are added by ``augment``.
The object is central, complete in the frame and larger than anything else: that is what "salient"
means here. Holes in it show what is behind it and are not part of the mask.
"""

import sys
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.network.train_config import WorldConfig
from mattgs_ops.segment.training_images.draw import Camera, Canvas, Light
from mattgs_ops.segment.training_images.figure_families import random_figure
from mattgs_ops.segment.training_images.figures import (
    Figure,
    draw_figure,
    figure_shadow,
)
from mattgs_ops.segment.training_images.organic import organic_scene
from mattgs_ops.segment.training_images.plain_grounds import (
    ground_light,
    like_ground,
    paint_ground,
    random_ground,
    turntable,
)
from mattgs_ops.segment.training_images.rooms import paint_room, room_light
from mattgs_ops.segment.training_images.solids import Array, Colour, Face, Paint
from mattgs_ops.segment.training_images.textures import Bank
from mattgs_ops.segment.training_images.things import OBJECTS, clutter
from mattgs_ops.segment.training_images.traced.backdrops import Backdrop

Image = NDArray[np.uint8]
SUPERSAMPLE = 2
SPAN = (0.4, 0.98)  # share of the frame's half that an object reaches
CUT_SHARE = 0.06  # of objects that the frame's edge cuts
ASPECTS = (4 / 3, 4 / 3, 3 / 4, 1.0, 16 / 9, 9 / 16)  # of the photo that is squashed to a square


Thing = list[Face] | Figure


@dataclass(frozen=True)
class Composites:
    """Samples ``image`` [S, S, 3] uint8 RGB and ``mask`` [S, S] uint8 (255 = object)."""

    seed: int
    size: int
    bank: Bank
    backdrops: tuple[Backdrop, ...] = ()
    backdrop_share: float = 0.0
    world: WorldConfig = field(default_factory=WorldConfig)

    def sample(self, index: int) -> tuple[Image, Image]:
        """Draw one sample; the same seed and index always give the same one."""
        rng = np.random.default_rng((self.seed, index))
        side = self.size * SUPERSAMPLE
        if self.backdrops and rng.random() < self.backdrop_share:
            backdrop = self.backdrops[int(rng.integers(len(self.backdrops)))]
            thing = random_thing(rng, self.world.figures)
            image, mask = traced_scene(rng, side, self.bank, backdrop, thing, self.world)
        else:
            image, mask = self._painted(rng, side)
        small = (self.size, self.size)
        image = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
        mask = cv2.resize(mask, small, interpolation=cv2.INTER_AREA)
        return image, mask

    def _painted(self, rng: np.random.Generator, side: int) -> tuple[Image, Image]:
        draw = rng.random()
        if draw < self.world.walls:
            return organic_scene(rng, side, self.bank)
        if draw < self.world.walls + self.world.plain:
            return plain_scene(rng, side, self.bank, self.world)
        if draw < self.world.walls + self.world.plain + self.world.rooms:
            return room_scene(rng, side, self.bank, self.world)
        thing = random_thing(rng, self.world.figures)
        return desk_scene(rng, side, self.bank, thing, self.world)


def random_thing(
    rng: np.random.Generator, figures: float, colours: list[Colour] | None = None
) -> Thing:
    """Draw an object: a figure with the probability ``figures``, else one of ``things``."""
    if rng.random() < figures:
        return random_figure(rng, colours)
    paint = Paint.random(rng)
    paint.colours = colours or paint.colours
    return OBJECTS[int(rng.integers(len(OBJECTS)))](rng, paint)


def desk_scene(
    rng: np.random.Generator, side: int, bank: Bank, thing: Thing, world: WorldConfig
) -> tuple[Image, Image]:
    """Draw an object on a desk, seen from somewhere above it."""
    camera = look_at(rng, side, points_of(thing))
    canvas = Canvas(side, camera, Light.random(rng), bank, rng)
    canvas.wall()
    canvas.plane("desk", rng.uniform(4, 9), 0.0)
    for _ in range(int(rng.integers(0, 9))):
        canvas.sheet(rng.normal(0, 1.6, 2), rng.uniform(0.3, 1.6, 2))
    others = place_clutter(rng, camera, int(rng.integers(0, 14)))
    draw_in_order(canvas, thing, others, world.turntables)
    return canvas.image, canvas.mask


def plain_scene(
    rng: np.random.Generator, side: int, bank: Bank, world: WorldConfig
) -> tuple[Image, Image]:
    """Draw an object on cloth, paper or a bare table, at times of nearly the ground's colour."""
    kind, colour = random_ground(rng)
    colours = like_ground(rng, colour) if rng.random() < 0.35 else None
    thing = random_thing(rng, world.figures, colours)
    camera = look_at(rng, side, points_of(thing))
    canvas = Canvas(side, camera, ground_light(rng, kind, camera.eye), bank, rng)
    paint_ground(canvas, kind, colour)
    others = place_clutter(rng, camera, int(rng.integers(1, 4)) if rng.random() < 0.15 else 0)
    draw_in_order(canvas, thing, others, world.turntables)
    return canvas.image, canvas.mask


def room_scene(
    rng: np.random.Generator, side: int, bank: Bank, world: WorldConfig
) -> tuple[Image, Image]:
    """Draw an object in a room, on a table, a stand or the floor."""
    thing = random_thing(rng, world.figures)
    points = points_of(thing)
    camera = look_at(rng, side, points, lowest=-2.0)
    canvas = Canvas(side, camera, room_light(rng, camera.eye), bank, rng)
    paint_room(canvas, points)
    others = place_clutter(rng, camera, int(rng.integers(1, 5)) if rng.random() < 0.4 else 0)
    draw_in_order(canvas, thing, others, world.turntables)
    return canvas.image, canvas.mask


def traced_scene(
    rng: np.random.Generator,
    side: int,
    bank: Bank,
    backdrop: Backdrop,
    thing: Thing,
    world: WorldConfig,
) -> tuple[Image, Image]:
    """Draw an object, and at times painted clutter around it, on a path-traced desk."""
    camera = backdrop.camera(side, float(rng.uniform(9, 15)))
    canvas = Canvas(side, camera, Light.random(rng), bank, rng)
    canvas.image = backdrop.on_canvas(side)
    others = place_clutter(rng, camera, int(rng.integers(0, 5)))
    draw_in_order(canvas, thing, others, world.turntables)
    return canvas.image, canvas.mask


def points_of(thing: Thing) -> Array:
    """Return points [K, 3] around an object."""
    if isinstance(thing, Figure):
        return thing.points
    return np.concatenate([face.contours[0] for face in thing])


def draw_in_order(
    canvas: Canvas, thing: Thing, others: list[list[Face]], turntables: float
) -> None:
    """Draw shadows, the farther clutter, the object, the nearer clutter.

    With the probability ``turntables`` the object stands on a disc, and no clutter beside it.
    """
    if turntables and canvas.rng.random() < turntables:
        canvas.draw(turntable(canvas.rng, points_of(thing)), is_object=False)
        others = []
    cast = [] if isinstance(thing, Figure) else thing
    casting = [*cast, *(face for faces in others for face in faces)]
    if casting:
        canvas.shadows(casting)
    if isinstance(thing, Figure):
        figure_shadow(canvas, thing)
    eye = canvas.camera.eye
    far = [float(np.linalg.norm(faces[0].contours[0].mean(0) - eye)) for faces in others]
    reach = float(np.linalg.norm(eye))
    order = sorted(range(len(others)), key=lambda i: -far[i])
    for i in order:
        if far[i] >= reach:
            canvas.draw(others[i], is_object=False)
    if canvas.rng.random() < 0.3:
        canvas.blur(float(canvas.rng.uniform(0.5, 2.0)))
    if isinstance(thing, Figure):
        draw_figure(canvas, thing)
    else:
        canvas.draw(thing, is_object=True)
    for i in order:
        if far[i] < reach:
            canvas.draw(others[i], is_object=False)


def look_at(rng: np.random.Generator, side: int, points: Array, lowest: float = 8.0) -> Camera:
    """Put a camera on an orbit around points [K, 3], which come to lie near the frame's middle.

    ``lowest`` is the least elevation, degrees. Most objects are wholly in the frame, a few reach
    over its edge.
    """
    middle = (points.min(0) + points.max(0)) / 2
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(lowest, 70))
    backward = np.array(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    focal, aspect = rng.uniform(0.9, 2.2), ASPECTS[int(rng.integers(len(ASPECTS)))]
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    target = middle + rng.normal(0, 0.12, 3) * radius
    eye = target + backward * radius * focal * 2.5
    camera = Camera.facing(eye, target, side, focal, aspect, rng.normal(0, 0.06))
    # move along the view axis until the object spans the wanted share of the frame
    wanted = rng.uniform(*SPAN) if rng.random() > CUT_SHARE else rng.uniform(1.0, 1.25)
    for _ in range(4):
        pixels, _ = camera.project(points)
        span = float(np.abs(pixels / side - 0.5).max()) * 2
        eye = target + (eye - target) * np.clip(span / wanted, 0.5, 2.0)
        camera = Camera.facing(eye, target, side, focal, aspect, camera.roll)
    return camera


def place_clutter(rng: np.random.Generator, camera: Camera, count: int) -> list[list[Face]]:
    """Spread other things on the desk, outside the object's own circle."""
    placed = []
    for _ in range(count):
        angle = rng.uniform(0, 2 * np.pi)
        distance = 1.15 + rng.exponential(0.7)
        spot = distance * np.array([np.cos(angle), np.sin(angle), 0])
        toward_eye = float(spot[:2] @ camera.eye[:2]) / float(np.linalg.norm(camera.eye[:2]) + 1e-9)
        if toward_eye > 0.6 * distance and rng.random() < 0.85:
            spot = -spot  # seldom in front of the object
        faces = clutter(rng)
        for face in faces:
            face.contours = [contour + spot for contour in face.contours]
        placed.append(faces)
    return placed


def sheet(count: int = 30, columns: int = 10, size: int = 128, seed: int = 7) -> Image:
    """Return a page [H, W, 3] of samples of the default shares, their masks beneath."""
    source, rows = Composites(seed, size, Bank(seed)), []
    for start in range(0, count, columns):
        pairs = [source.sample(index) for index in range(start, start + columns)]
        cells = [np.concatenate([image, np.repeat(mask[..., None], 3, 2)]) for image, mask in pairs]
        rows.append(np.concatenate(cells, axis=1))
    return np.concatenate(rows)


if __name__ == "__main__":
    cv2.imwrite(sys.argv[1], sheet()[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
