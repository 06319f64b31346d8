"""Sparse models as plain numpy arrays, and the votes of masks on their points.

A sparse model is what structure-from-motion leaves behind: cameras, posed images with their key
points, and triangulated points (``formats/colmap_model.py`` reads and writes COLMAP's files). Poses
are world-to-camera, the centre of the top-left pixel is at (0.5, 0.5).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from mattgs_ops.capture.camera import Camera, in_frame
from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.scene import SparsePoints

Array = NDArray[np.float64]

NO_POINT = -1
NO_ERROR = -1.0  # a point's reprojection error where nobody measured one
# A point belongs to the object when at least this share of the views that see it agree.
OBJECT_SHARE = 0.8


@dataclass(frozen=True)
class SparseImage:
    """A posed image; ``xy`` are key points in pixels, ``points`` their rows in the cloud or -1."""

    name: str
    camera: int
    rotation: Array  # [3, 3] world-to-camera
    translation: Array  # [3]
    xy: Array  # [K, 2]
    points: NDArray[np.int64]  # [K]


@dataclass(frozen=True)
class SparseModel:
    """Cameras and images by their numbers in COLMAP; points ``xyz`` [P, 3], ``rgb`` [P, 3] uint8.

    ``error`` [P] is each point's mean reprojection error in pixels, -1 where unknown.
    """

    cameras: Mapping[int, ColmapCamera]
    images: Mapping[int, SparseImage]
    xyz: Array
    rgb: NDArray[np.uint8]
    error: Array

    def observations(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
        """Return image number [O], point row [O] and key point [O, 2] of every observation."""
        images, points, xy = [], [], []
        for number, image in self.images.items():
            seen = image.points != NO_POINT
            images.append(np.full(int(seen.sum()), number, dtype=np.int64))
            points.append(image.points[seen])
            xy.append(image.xy[seen])
        if not images:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2))
        return np.concatenate(images), np.concatenate(points), np.concatenate(xy)


def object_points(
    model: SparseModel,
    views: Mapping[int, Camera],
    masks: Mapping[int, NDArray[np.uint8]],
) -> SparsePoints:
    """Let every view that sees a point vote whether the point's projection lies in its mask.

    ``views`` and ``masks`` [H, W] (255 = object) go by image number and describe the same image
    plane. A projection outside the image votes against. On a point that no view is known to see,
    as those of a point cloud's file, all views vote in whose image it lies.
    """
    numbers, points, _ = model.observations()
    votes, seen = np.zeros(len(model.xyz)), np.zeros(len(model.xyz), dtype=np.int32)
    unknown = np.setdiff1d(np.arange(len(model.xyz)), points)
    for number, mask in masks.items():
        rows = points[numbers == number]
        if len(unknown):
            height, width = mask.shape
            framed = in_frame(*views[number].project(model.xyz[unknown]), (width, height))
            rows = np.concatenate([rows, unknown[framed]])
        np.add.at(seen, rows, 1)
        np.add.at(votes, rows, inside(mask, *views[number].project(model.xyz[rows])))
    share = np.divide(votes, seen, out=np.zeros_like(votes), where=seen > 0)
    return SparsePoints(model.xyz, model.rgb, share.astype(np.float32), seen)


def inside(mask: NDArray[np.uint8], pixels: Array, depths: Array) -> NDArray[np.bool_]:
    """Say for each projection [N, 2] with depth [N] whether it falls on an object pixel."""
    height, width = mask.shape
    framed = in_frame(pixels, depths, (width, height))
    cells = pixels[framed].astype(np.int64)
    hit = np.zeros(len(pixels), dtype=bool)
    hit[framed] = mask[cells[:, 1], cells[:, 0]] > 0
    return hit


def on_object(points: SparsePoints, share: float = OBJECT_SHARE) -> SparsePoints:
    """Keep the points that lie on the object."""
    return points.chosen(are_on_object(points, share))


def are_on_object(points: SparsePoints, share: float = OBJECT_SHARE) -> NDArray[np.bool_]:
    """Say which points [P] at least ``share`` of the views that see them place on the object."""
    # float32 shares such as 4/5 lie a hair beside the float64 threshold
    found: NDArray[np.bool_] = points.object_share >= np.float32(share)
    return found


def write_ply(points: SparsePoints, path: Path) -> None:
    """Write points as a binary PLY with positions, colours and the share of object votes."""
    layout = [(name, "<f4") for name in "xyz"]
    layout += [(name, "u1") for name in ("red", "green", "blue")] + [("object_share", "<f4")]
    rows = np.zeros(len(points.xyz), dtype=layout)
    for index, axis in enumerate("xyz"):
        rows[axis] = points.xyz[:, index]
    for index, channel in enumerate(("red", "green", "blue")):
        rows[channel] = points.rgb[:, index]
    rows["object_share"] = points.object_share
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(path))
