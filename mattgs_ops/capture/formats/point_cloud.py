"""Sparse points that came with a capture: a PLY file, or the points of a COLMAP model."""

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyParseError

from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.scene import GivenPoints
from mattgs_ops.errors import InputError

GREY = 127  # colour of points that have none
COLOURS = ("red", "green", "blue")


def read_points(path: Path) -> GivenPoints:
    """Read a PLY file or a COLMAP model's folder; raises :class:`InputError` naming the trouble.

    Photos have the names that the COLMAP model gives them. Points that are not finite are left out.
    """
    points = _from_model(path) if path.is_dir() else _from_ply(path)
    finite = np.asarray(np.isfinite(points.xyz).all(axis=1))
    if finite.all():
        return points
    row = np.cumsum(finite) - 1
    seen = points.seen[finite[points.seen[:, 1]]]
    seen = np.stack([seen[:, 0], row[seen[:, 1]]], axis=1)
    return GivenPoints(points.xyz[finite], points.rgb[finite], points.photos, seen)


def _from_model(folder: Path) -> GivenPoints:
    model = read_model(folder)
    images = list(model.images.values())
    rows = [np.unique(image.points[image.points >= 0]) for image in images]
    seen = [np.stack([np.full(len(r), i), r], axis=1) for i, r in enumerate(rows)]
    together = np.concatenate(seen) if seen else np.zeros((0, 2))
    names = tuple(image.name for image in images)
    return GivenPoints(model.xyz, model.rgb, names, together.astype(np.int64))


def _from_ply(path: Path) -> GivenPoints:
    try:
        vertex = PlyData.read(str(path))["vertex"].data
        xyz = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(np.float64)
    except (PlyParseError, OSError, KeyError, ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected a PLY file of points (x, y, z): {error}") from error
    rgb = np.full(xyz.shape, GREY, dtype=np.uint8)
    if set(COLOURS) <= set(vertex.dtype.names or ()):
        colours = np.stack([vertex[name] for name in COLOURS], axis=1)
        if np.issubdtype(colours.dtype, np.floating):  # in [0, 1], as some tools write them
            colours = np.rint(np.clip(colours, 0, 1) * 255)
        rgb = np.clip(colours, 0, 255).astype(np.uint8)
    return GivenPoints(xyz, rgb, (), np.zeros((0, 2), dtype=np.int64))
