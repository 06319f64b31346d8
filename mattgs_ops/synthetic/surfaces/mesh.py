"""Triangle meshes from a few parameters: bevelled boxes, turned parts, tubes, prisms.

A :class:`Mesh` holds vertices, unit normals and texture coordinates per vertex, faces wound so that
their front is where the normals point. Lengths are centimetres; every solid is centred in x and y
and, unless said otherwise, stands on z = 0. Sharp edges get a small bevel with interpolated
normals, because edges without a highlight are what gives a rendering away.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """``vertices`` [N, 3], ``normals`` [N, 3], ``uvs`` [N, 2], ``faces`` [M, 3] int."""

    vertices: Array
    normals: Array
    uvs: Array
    faces: NDArray[np.int64]

    def transformed(self, matrix: Array) -> "Mesh":
        """Apply an affine matrix [4, 4] without shear or mirroring."""
        vertices = self.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        normals = self.normals @ np.linalg.inv(matrix[:3, :3])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return Mesh(vertices, normals / np.maximum(length, 1e-12), self.uvs, self.faces)

    def at(self, x: float = 0, y: float = 0, z: float = 0) -> "Mesh":
        """Move."""
        return Mesh(self.vertices + np.array([x, y, z]), self.normals, self.uvs, self.faces)

    def turned(self, x: float = 0, y: float = 0, z: float = 0) -> "Mesh":
        """Rotate about the axes through the origin, x first, in degrees."""
        return self.transformed(rotation(x, y, z))

    def with_uv(self, left: float, top: float, right: float, bottom: float) -> "Mesh":
        """Map the unit square of texture coordinates to a rectangle of the texture."""
        uvs = self.uvs * [right - left, bottom - top] + [left, top]
        return Mesh(self.vertices, self.normals, uvs, self.faces)


def rotation(x: float = 0, y: float = 0, z: float = 0) -> Array:
    """Return the rotation [4, 4] about x, then y, then z, in degrees."""
    out = np.eye(4)
    for axis, angle in enumerate(np.radians([x, y, z])):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(4)
        step[a, a] = step[b, b] = np.cos(angle)
        step[a, b], step[b, a] = -np.sin(angle), np.sin(angle)
        out = step @ out
    return out


def join(meshes: Iterable[Mesh]) -> Mesh:
    """Concatenate at least one mesh."""
    parts = list(meshes)
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uvs for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )


def quad(width: float, depth: float) -> Mesh:
    """Return a flat rectangle facing up; an image on it is upright seen from -y."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    vertices = np.column_stack([corners * [width / 2, depth / 2], np.zeros(4)])
    uvs = (corners + 1) / 2 * [1, -1] + [0, 1]
    return Mesh(vertices, np.tile([0.0, 0, 1], (4, 1)), uvs, np.array([[0, 1, 2], [0, 2, 3]]))


def box(width: float, depth: float, height: float, bevel: float = 0.05) -> Mesh:
    """Return a box standing on z = 0 with bevelled edges."""
    half = np.array([width, depth, height]) / 2
    bevel = min(bevel, 0.45 * float(half.min()))
    signs, axes, faces = _box_topology()
    faced = np.arange(3) == axes[:, None]
    points = np.where(faced, signs * half, signs * (half - bevel))
    directions = np.where(faced, signs, 0.0)
    ordered = wind(points, directions, faces)
    uvs = (points[:, :2] / half[:2] + 1) / 2 * [1, -1] + [0, 1]
    return Mesh(points, directions, uvs, ordered).at(0, 0, height / 2)


@cache
def _box_topology() -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Return a bevelled box's corners [24, 3] as signs, the axis each faces [24], faces [44, 3].

    Every corner is there three times, once for each side that meets there.
    """
    signs = [(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]
    index = {
        corner: k for k, corner in enumerate((sign, axis) for sign in signs for axis in range(3))
    }
    faces = [[index[sign, 0], index[sign, 1], index[sign, 2]] for sign in signs]
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1, 1):
            loop = [_sign(axis, side, b, p, c, q) for p, q in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            faces += fan([index[sign, axis] for sign in loop])
        for p, q in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            low, high = _sign(axis, -1, b, p, c, q), _sign(axis, 1, b, p, c, q)
            faces += fan([index[low, b], index[high, b], index[high, c], index[low, c]])
    corners = np.array([sign for sign, _ in index], dtype=np.float64)
    return corners, np.array([axis for _, axis in index]), np.array(faces)


def lathe(profile: Sequence[tuple[float, float]], segments: int = 32, smooth: bool = False) -> Mesh:
    """Turn a profile of (radius, z) about the z axis.

    Going along the profile the surface's outside is on the right-hand side, so a profile from the
    bottom to the top of the axis encloses a solid. Texture: u around, v along the profile.
    """
    points = np.array(profile, dtype=np.float64)
    angles = np.linspace(0, 2 * np.pi, segments + 1)
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    edges = np.diff(points, axis=0)
    outward = np.column_stack([edges[:, 1], -edges[:, 0]])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(edges, axis=1))])
    length /= length[-1]
    rings = (
        _smooth_rings(points, outward, length) if smooth else _flat_rings(points, outward, length)
    )
    return join(_band(lower, upper, around, angles) for lower, upper in rings)


def cylinder(radius: float, height: float, bevel: float = 0.04, segments: int = 32) -> Mesh:
    """Return a solid cylinder standing on z = 0 with bevelled rims."""
    b = min(bevel, 0.45 * radius, 0.45 * height)
    rim = [(0, 0), (radius - b, 0), (radius, b), (radius, height - b), (radius - b, height)]
    return lathe([*rim, (0, height)], segments)


def ball(radius: float, segments: int = 20) -> Mesh:
    """Return a sphere about the origin."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    profile = [(radius * max(float(np.cos(a)), 0.0), radius * float(np.sin(a))) for a in angles]
    return lathe(profile, segments, smooth=True)


def curve(points: Sequence[Sequence[float]], steps: int = 10) -> Array:
    """Return a Catmull–Rom curve through the points [P, 3], ``steps`` samples per stretch."""
    p = np.array(points, dtype=np.float64)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    t = np.linspace(0, 1, steps, endpoint=False)[:, None]
    out = []
    for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:], strict=True):
        out.append(
            b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
        )
    return np.concatenate([*out, p[-2:-1]])


def tube(path: Array, radius: float, segments: int = 8) -> Mesh:
    """Return a round tube along a path [P, 3], without caps."""
    tangents = np.gradient(path, axis=0)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    side = np.cross(tangents[0], [0.31, 0.17, 0.93])
    angles = np.linspace(0, 2 * np.pi, segments + 1)
    vertices, normals = [], []
    for point, tangent in zip(path, tangents, strict=True):
        side = side - tangent * float(side @ tangent)  # carried along without twist
        side /= np.linalg.norm(side)
        other = np.cross(tangent, side)
        ring = np.outer(np.cos(angles), side) + np.outer(np.sin(angles), other)
        vertices.append(point + radius * ring)
        normals.append(ring)
    count = len(path)
    v, u = np.meshgrid(np.linspace(0, 1, count), angles / (2 * np.pi), indexing="ij")
    points, directions = np.concatenate(vertices), np.concatenate(normals)
    faces = wind(points, directions, _grid_faces(count, segments + 1))
    return Mesh(points, directions, np.column_stack([u.ravel(), v.ravel()]), faces)


def prism(outline: Sequence[tuple[float, float]], height: float, bevel: float = 0.05) -> Mesh:
    """Extrude an outline that is star-shaped about its mean, counter-clockwise, from z = 0."""
    ring = np.array(outline, dtype=np.float64)
    centre = ring.mean(axis=0)
    edges = np.roll(ring, -1, axis=0) - ring
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mitre = normals + np.roll(normals, 1, axis=0)
    mitre /= np.maximum((mitre * normals).sum(axis=1, keepdims=True), 0.3)
    inner = ring - bevel * mitre
    parts = []
    for z, side in ((0.0, -1.0), (height, 1.0)):
        cap = np.column_stack([np.concatenate([[centre], inner]), np.full(len(ring) + 1, z)])
        up = np.tile([0.0, 0, side], (len(cap), 1))
        fan = [[0, 1 + i, 1 + (i + 1) % len(ring)] for i in range(len(ring))]
        parts.append(Mesh(cap, up, _planar_uv(cap, ring), wind(cap, up, np.array(fan))))
    levels = [
        (inner, 0.0, -1.0),
        (ring, bevel, 0.0),
        (ring, height - bevel, 0.0),
        (inner, height, 1.0),
    ]
    for (low, z0, n0), (high, z1, n1) in pairwise(levels):
        for i in range(len(ring)):
            j = (i + 1) % len(ring)
            corners = np.array([[*low[i], z0], [*low[j], z0], [*high[j], z1], [*high[i], z1]])
            tilt = np.array([[*normals[i] * (1 - abs(n)), n] for n in (n0, n0, n1, n1)])
            faces = wind(corners, tilt, np.array([[0, 1, 2], [0, 2, 3]]))
            parts.append(Mesh(corners, tilt, _planar_uv(corners, ring), faces))
    return join(parts)


def write_ply(mesh: Mesh, path: Path) -> None:
    """Write a binary PLY with normals and texture coordinates, as Mitsuba reads it.

    Not by plyfile, which writes lists of faces one by one in Python: 0.9 s for 400,000.
    """
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")]
    header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    rows = np.column_stack([mesh.vertices, mesh.normals, mesh.uvs]).astype("<f4")
    faces = np.zeros(len(mesh.faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, mesh.faces
    text = "\n".join([*header, "end_header", ""])
    path.write_bytes(text.encode("ascii") + rows.tobytes() + faces.tobytes())


def _sign(a: int, p: int, b: int, q: int, c: int, r: int) -> tuple[int, int, int]:
    out = [0, 0, 0]
    out[a], out[b], out[c] = p, q, r
    return out[0], out[1], out[2]


def fan(loop: Sequence[int]) -> list[list[int]]:
    """Return the triangles of a convex polygon's vertex numbers, all from the first."""
    return [[loop[0], loop[i], loop[i + 1]] for i in range(1, len(loop) - 1)]


def wind(points: Array, normals: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return faces [F, 3] turned so that their front is where the normals [N, 3] point."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    away = (np.cross(b - a, c - a) * normals[faces].sum(axis=1)).sum(axis=1) < 0
    wound: NDArray[np.int64] = np.where(away[:, None], faces[:, ::-1], faces)
    return wound


def _planar_uv(points: Array, ring: Array) -> Array:
    low, high = ring.min(axis=0), ring.max(axis=0)
    share: Array = (points[:, :2] - low) / (high - low)
    return share * [1, -1] + [0, 1]


def _grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a = (i * columns + j).ravel()
    first = np.column_stack([a, a + 1, a + columns + 1])
    return np.concatenate([first, np.column_stack([a, a + columns + 1, a + columns])])


Ring = tuple[Array, Array, float]  # (radius, z), outward (radius, z), v


def _flat_rings(points: Array, outward: Array, length: Array) -> list[tuple[Ring, Ring]]:
    return [
        ((points[i], outward[i], length[i]), (points[i + 1], outward[i], length[i + 1]))
        for i in range(len(outward))
    ]


def _smooth_rings(points: Array, outward: Array, length: Array) -> list[tuple[Ring, Ring]]:
    mean = np.concatenate([outward[:1], outward[1:] + outward[:-1], outward[-1:]])
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    rings = [(points[i], mean[i], float(length[i])) for i in range(len(points))]
    return list(pairwise(rings))


def _band(lower: Ring, upper: Ring, around: Array, angles: Array) -> Mesh:
    vertices, normals, uvs = [], [], []
    for (radius, z), (out, up), v in (lower, upper):
        vertices.append(np.column_stack([around * radius, np.full(len(around), z)]))
        normals.append(np.column_stack([around * out, np.full(len(around), up)]))
        uvs.append(np.column_stack([angles / (2 * np.pi), np.full(len(around), 1 - v)]))
    points, directions = np.concatenate(vertices), np.concatenate(normals)
    faces = wind(points, directions, _grid_faces(2, len(around)))
    return Mesh(points, directions, np.concatenate(uvs), faces)
