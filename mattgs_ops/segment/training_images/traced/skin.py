"""One skin around many shapes: signed distances, melted together, dented by noise.

Statues, stones, bones and toys have no edges that a list of separate shapes could draw. Here each
shape is a signed distance and their union a polynomial smooth minimum (Quilez, "Distance functions"
and "Smooth minimum"); marching cubes finds the skin, and noise moves it in and out.
"""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from skimage.measure import marching_cubes

from mattgs_ops.segment.training_images.figures import Shape, surface_points
from mattgs_ops.segment.training_images.solids import Array
from mattgs_ops.synthetic.surfaces.mesh import Mesh

CELLS = 96  # of the grid along the longest side
THIN = 1.2  # cells: the least half-width that the grid still shows
OCTAVES = (3, 6, 12, 24, 48)  # waves of the noise across the thing


def melt(solids: Sequence[Shape], hollows: Sequence[Shape], *, blend: float) -> Mesh:
    """Return the skin of the shapes' smooth union, less the hollows; ``blend`` is its radius."""
    points = np.concatenate([surface_points(shape) for shape in solids])
    low, high = points.min(0) - 2 * blend - 0.02, points.max(0) + 2 * blend + 0.02
    step = float((high - low).max()) / (CELLS - 1)
    counts = np.ceil((high - low) / step).astype(np.int64) + 1
    field = np.full(counts, 2.0 * blend + 2 * step)
    for shape in solids:
        part, near = _near(shape, low, step, counts, blend + 2 * step)
        away = _distance(shape, near, THIN * step)
        field[part] = _smooth_minimum(field[part], away, blend)
    for shape in hollows:
        part, near = _near(shape, low, step, counts, blend + 2 * step)
        away = _distance(shape, near, THIN * step)
        field[part] = -_smooth_minimum(-field[part], away, blend)
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(step, step, step))
    return _with_normals(vertices.astype(np.float64) + low, faces.astype(np.int64))


def dent(mesh: Mesh, rng: Generator, depth: float, falloff: float) -> Mesh:
    """Move the skin in and out by noise; each octave is ``falloff`` times as deep as the last."""
    if depth <= 0:
        return mesh
    low, span = mesh.vertices.min(0), float(np.ptp(mesh.vertices, axis=0).max())
    moved, weight = np.zeros(len(mesh.vertices)), 1.0
    for waves in OCTAVES:
        grid = rng.standard_normal((waves + 3,) * 3)
        at = (mesh.vertices - low) / span * waves + 1
        moved += weight * map_coordinates(grid, at.T, order=2, mode="nearest")
        weight *= falloff
    moved /= max(float(moved.std()), 1e-9)
    vertices = mesh.vertices + depth * moved[:, None] * mesh.normals
    return _with_normals(vertices, mesh.faces)


def _near(
    shape: Shape, low: Array, step: float, counts: NDArray[np.int64], margin: float
) -> tuple[tuple[slice, ...], Array]:
    """Return the part of the grid around a shape, and its points [A, B, C, 3]."""
    around = surface_points(shape)
    first = np.clip(np.floor((around.min(0) - margin - low) / step).astype(int), 0, counts - 1)
    last = np.clip(
        np.ceil((around.max(0) + margin - low) / step).astype(int) + 1, first + 1, counts
    )
    axes = [low[k] + step * np.arange(first[k], last[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return tuple(slice(a, b) for a, b in zip(first, last, strict=True)), grid


def _distance(shape: Shape, points: Array, least: float) -> Array:
    """Return the signed distance of points [..., 3]; half-widths are at least ``least``."""
    widths = np.linalg.norm(shape.axes, axis=0)
    local = (points - shape.centre) @ (shape.axes / np.maximum(widths, 1e-9))
    widths = np.maximum(widths, least)
    if shape.kind == "ball":  # of an ellipsoid, near enough
        far = np.linalg.norm(local / widths, axis=-1)
        return np.asarray(
            far * (far - 1) / np.maximum(np.linalg.norm(local / widths**2, axis=-1), 1e-9)
        )
    if shape.kind == "drum":
        radius = widths[:2].mean()
        across = np.linalg.norm(local[..., :2], axis=-1) - radius
        beyond = np.stack([across, np.abs(local[..., 2]) - widths[2]], axis=-1)
    else:
        beyond = np.abs(local) - widths
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
    return np.asarray(outside + np.minimum(beyond.max(-1), 0))


def _smooth_minimum(a: Array, b: Array, blend: float) -> Array:
    """Return the polynomial smooth minimum of Quilez; melts within ``blend``."""
    share = np.maximum(blend - np.abs(a - b), 0) / blend
    return np.asarray(np.minimum(a, b) - share * share * blend / 4)


def _with_normals(vertices: Array, faces: NDArray[np.int64]) -> Mesh:
    """Return a closed mesh with smooth normals; a texture goes around it twice, mirrored."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    if float((flat * (a + b + c)).sum()) < 0:  # the enclosed volume is positive where they face out
        faces, flat = faces[:, ::-1], -flat
    sums = [
        np.bincount(faces.ravel(), np.repeat(flat[:, k], 3), minlength=len(vertices))
        for k in range(3)
    ]
    normals: Array = np.stack(sums, axis=1)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    low, span = vertices[:, 2].min(), max(float(np.ptp(vertices[:, 2])), 1e-9)
    middle = vertices[:, :2].mean(0)
    around = np.abs(np.arctan2(vertices[:, 1] - middle[1], vertices[:, 0] - middle[0])) / np.pi
    uvs = np.stack([around, 1 - (vertices[:, 2] - low) / span], axis=1)
    return Mesh(vertices, normals, uvs, faces)
