"""Figures of balls, blocks and drums for training images, ray-cast per pixel.

Statues of plaster, toys and models have round shading that flat faces do not show. A figure is a
list of unit shapes, each stretched by a matrix; ``figure_families`` makes them.
World as in ``solids``: z up, standing on z = 0 around the origin, about one unit wide.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.training_images.draw import Camera, Canvas
from mattgs_ops.segment.training_images.solids import (
    Array,
    Colour,
)
from mattgs_ops.segment.training_images.textures import SIZE

Kind = Literal["ball", "block", "drum"]
Floats = NDArray[np.float32]
FAR = 1e9  # depth of rays that hit nothing
TINY = 1e-9  # keeps divisions finite
CONTACT = 0.25  # world units above the ground up to which less of the sky is seen
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_AROUND = np.linspace(0, 2 * np.pi, 16, endpoint=False)
_RIM = np.stack([np.cos(_AROUND), np.sin(_AROUND), 0 * _AROUND], 1)
_BELTS = [np.cos(a) * _RIM + np.array([0, 0, np.sin(a)]) for a in np.linspace(-1.4, 1.4, 7)]
SHELLS: dict[Kind, Array] = {  # points on the unit shapes, whose hull is nearly the shape
    "ball": np.concatenate(_BELTS),
    "block": CORNERS,
    "drum": np.concatenate([_RIM + np.array([0, 0, z]) for z in (-1, 1)]),
}


@dataclass(frozen=True, eq=False)
class Shape:
    """A unit ball, a cube or a cylinder of half-width 1, as ``centre + axes @ p``; axes [3, 3]."""

    kind: Kind
    centre: Array
    axes: Array
    colour: Colour


@dataclass(frozen=True, eq=False)
class Figure:
    """``pattern`` tells whether a pattern of the bank lies on it; ``gloss`` 0..1."""

    shapes: list[Shape]
    pattern: bool
    gloss: float
    carved: float  # how far normals stray, as on hewn stone

    @property
    def points(self) -> Array:
        """Return points [K, 3] on all shapes."""
        return np.concatenate([surface_points(shape) for shape in self.shapes])


def surface_points(shape: Shape) -> Array:
    """Return points [K, 3] whose convex hull is nearly the shape."""
    return np.asarray(SHELLS[shape.kind] @ shape.axes.T + shape.centre)


Hits = tuple[Floats, NDArray[np.int64], Floats]  # depth, shape, unit normal, of each pixel


def cast(shapes: list[Shape], camera: Camera) -> Hits:
    """Return depth [S, S] along the view axis (FAR: nothing), shape [S, S], normal [S, S, 3]."""
    side = camera.side
    depth = np.full((side, side), FAR, np.float32)
    which = np.full((side, side), -1, np.int64)
    normals = np.zeros((side, side, 3), np.float32)
    rays = rays_of(camera).astype(np.float32)
    for index, shape in enumerate(shapes):
        pixels, _ = camera.project(CORNERS @ shape.axes.T + shape.centre)
        left, top = np.clip(np.floor(pixels.min(0)), 0, side).astype(int)
        right, bottom = np.clip(np.ceil(pixels.max(0)), 0, side).astype(int)
        window = (slice(top, bottom), slice(left, right))
        inverse = np.linalg.inv(shape.axes).astype(np.float32)
        start = inverse @ (camera.eye - shape.centre).astype(np.float32)
        along = rays[window].reshape(-1, 3) @ inverse.T
        if not len(along):
            continue
        found, local = _UNITS[shape.kind](start, along)
        found = found.reshape(bottom - top, right - left)
        nearer = found < depth[window]
        outward = local[nearer.reshape(-1)] @ inverse
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
        depth[window][nearer], which[window][nearer] = found[nearer], index
        normals[window][nearer] = outward
    return depth, which, normals


def rays_of(camera: Camera) -> Array:
    """Return the rays [S, S, 3] through the pixels' centres, of length 1 along the view axis."""
    rows, columns = np.mgrid[: camera.side, : camera.side] + 0.5
    seen = np.ones((camera.side, camera.side, 3))
    seen[..., 0] = (columns - camera.side / 2) / camera.scale[0]
    seen[..., 1] = (rows - camera.side / 2) / camera.scale[1]
    return np.asarray(seen @ camera.rotation)


def _ball(start: Floats, along: Floats) -> tuple[Floats, Floats]:
    a, b = np.einsum("ij,ij->i", along, along), along @ start
    inside = b * b - a * (start @ start - 1)
    depth = (-b - np.sqrt(np.maximum(inside, 0))) / a
    depth = np.where((inside > 0) & (depth > 0), depth, FAR).astype(np.float32)
    return depth, np.asarray(start + depth[:, None] * along, np.float32)


def _block(start: Floats, along: Floats) -> tuple[Floats, Floats]:
    safe = np.where(np.abs(along) < TINY, TINY, along)
    ends = np.stack([(-1 - start) / safe, (1 - start) / safe])
    entry, leave = ends.min(0), ends.max(0)
    axis, depth = entry.argmax(1), entry.max(1)
    normal = np.zeros_like(along)
    rows = np.arange(len(along))
    normal[rows, axis] = -np.sign(along[rows, axis])
    hit = (depth < leave.min(1)) & (depth > 0)
    return np.where(hit, depth, FAR).astype(np.float32), normal


def _drum(start: Floats, along: Floats) -> tuple[Floats, Floats]:
    a = np.maximum(along[:, 0] ** 2 + along[:, 1] ** 2, TINY)
    b = along[:, :2] @ start[:2]
    inside = b * b - a * (start[:2] @ start[:2] - 1)
    root = np.sqrt(np.maximum(inside, 0))
    safe = np.where(np.abs(along[:, 2]) < TINY, TINY, along[:, 2])
    caps = np.stack([(-1 - start[2]) / safe, (1 - start[2]) / safe])
    side, cap = (-b - root) / a, caps.min(0)
    depth = np.maximum(side, cap)
    leave = np.minimum((-b + root) / a, caps.max(0))
    normal = start + depth[:, None] * along
    normal[:, 2] = 0
    flat = cap > side
    normal[flat] = 0
    normal[flat, 2] = -np.sign(along[flat, 2])
    hit = (inside > 0) & (depth < leave) & (depth > 0)
    return np.where(hit, depth, FAR).astype(np.float32), normal


_UNITS: dict[Kind, Callable[[Floats, Floats], tuple[Floats, Floats]]] = {
    "ball": _ball,
    "block": _block,
    "drum": _drum,
}


def draw_figure(canvas: Canvas, figure: Figure) -> None:
    """Cast the figure into the canvas, over everything drawn so far."""
    camera, light = canvas.camera, canvas.light
    depth, which, normals = cast(figure.shapes, camera)
    hit = depth < FAR
    points = camera.eye + depth[hit][:, None] * rays_of(camera)[hit]
    colours = np.array([shape.colour for shape in figure.shapes])[which[hit]]
    strayed = normals[hit] + figure.carved * np.sin(23 * points[:, [1, 2, 0]] + 7 * points)
    strayed /= np.linalg.norm(strayed, axis=1, keepdims=True)
    diffuse = np.maximum(strayed @ light.direction, 0)
    sky = 0.6 + 0.4 * strayed[:, 2]
    sky *= 0.55 + 0.45 * np.clip(points[:, 2] / CONTACT, 0, 1)
    shade = (light.ambient * sky + (1 - light.ambient) * diffuse) * _pattern(canvas, figure, points)
    toward = camera.eye - points
    half = toward / np.linalg.norm(toward, axis=1, keepdims=True) + light.direction
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    gloss = figure.gloss * np.maximum((strayed * half).sum(1), 0) ** 30
    shown = 255 * (colours * shade[:, None] + gloss[:, None])
    canvas.image[hit] = np.clip(shown, 0, 255).astype(np.uint8)
    canvas.mask[hit] = 255


def figure_shadow(canvas: Canvas, figure: Figure) -> None:
    """Darken the ground behind the figure, seen from the light, and softly under it."""
    thrown, under = [], []
    toward = canvas.light.direction
    for shape in figure.shapes:
        points = surface_points(shape)
        thrown.append(_hull(points - toward * (points[:, 2:] / toward[2])))
        if points[:, 2].min() < CONTACT:
            under.append(_hull(points * [1, 1, 0]))
    canvas.darken(thrown, under)


def _hull(points: Array) -> Array:
    """Return the convex outline [K, 3] of points [N, 3] on the ground."""
    flat = cv2.convexHull(points[:, :2].astype(np.float32))[:, 0].astype(np.float64)
    return np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)


def _pattern(canvas: Canvas, figure: Figure, points: Array) -> Floats:
    if not figure.pattern:
        return np.ones(len(points), np.float32)
    pattern = canvas.bank.pick(canvas.rng, "object")
    scale = canvas.rng.uniform(60, 300)
    u = (scale * (points[:, 0] + 0.6 * points[:, 1])).astype(np.int64) % SIZE
    v = (scale * (points[:, 2] + 0.3 * points[:, 1])).astype(np.int64) % SIZE
    low = canvas.rng.uniform(0.3, 0.9)
    return np.asarray(low + (1 - low) * pattern[v, u] / 255, np.float32)
