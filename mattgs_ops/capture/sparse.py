"""Sparse models as plain numpy arrays: COLMAP's binary files, mask votes, alignment, PLY.

A sparse model is what structure-from-motion leaves behind: cameras, posed images with their key
points, and triangulated points. Reading and writing need numpy alone, so that no process but the
one that reconstructs ever loads COLMAP. File layout: COLMAP's documentation, "Output Format"
(cameras.bin, images.bin, points3D.bin; little-endian). Poses are world-to-camera, quaternions
wxyz, the centre of the top-left pixel is at (0.5, 0.5).
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.scene import SparsePoints
from mattgs_ops.errors import InputError

Array = NDArray[np.float64]

# COLMAP's numbers of camera models and the lengths of their parameter lists
MODELS: dict[str, tuple[int, int]] = {
    "SIMPLE_PINHOLE": (0, 3),
    "PINHOLE": (1, 4),
    "SIMPLE_RADIAL": (2, 4),
    "RADIAL": (3, 5),
    "OPENCV": (4, 8),
}
NO_POINT = -1
# A point belongs to the object when at least this share of the views that see it agree.
OBJECT_SHARE = 0.8


@dataclass(frozen=True)
class ColmapCamera:
    """Intrinsics under COLMAP's names; ``params`` as COLMAP orders them, pixels."""

    model: str
    width: int
    height: int
    params: tuple[float, ...]


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


def rotation_of(quaternion: Array) -> Array:
    """Turn a wxyz quaternion [4] of any length into a rotation matrix [3, 3]."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: Array) -> Array:
    """Turn a rotation matrix [3, 3] into a unit quaternion wxyz with w >= 0.

    The quaternion is the eigenvector of the largest eigenvalue of Bar-Itzhack's 4×4 matrix
    (2000), which stays accurate for half turns where formulas by the trace do not.
    """
    r = rotation
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], 0.0, 0.0, 0.0],
            [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], 0.0, 0.0],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0.0],
            [
                r[1, 0] - r[0, 1],
                r[0, 2] + r[2, 0],
                r[1, 2] + r[2, 1],
                r[2, 2] - r[0, 0] - r[1, 1],
            ],
        ]
    )
    _, vectors = np.linalg.eigh(k)  # reads the lower triangle; eigenvalues ascend
    q: Array = vectors[:, -1]
    return -q if q[0] < 0 else q


def read_model(folder: Path) -> SparseModel:
    """Read COLMAP's binary model; raises :class:`InputError` naming the file and the trouble."""
    cameras = _read_cameras(folder / "cameras.bin")
    ids, xyz, rgb, error = _read_points(folder / "points3D.bin")
    images = _read_images(folder / "images.bin", ids)
    return SparseModel(cameras, images, xyz, rgb, error)


def write_model(model: SparseModel, folder: Path) -> None:
    """Write COLMAP's binary model into ``folder``, which is created."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "cameras.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.cameras)))
        for number, camera in sorted(model.cameras.items()):
            code, length = MODELS[camera.model]
            file.write(struct.pack("<iiQQ", number, code, camera.width, camera.height))
            file.write(struct.pack(f"<{length}d", *camera.params))
    tracks: list[list[tuple[int, int]]] = [[] for _ in range(len(model.xyz))]
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.images)))
        for number, image in sorted(model.images.items()):
            pose = (*quaternion_of(image.rotation), *image.translation)
            file.write(struct.pack("<i7di", number, *pose, image.camera))
            file.write(image.name.encode() + b"\0" + struct.pack("<Q", len(image.xy)))
            rows = np.zeros(len(image.xy), dtype=[("xy", "<f8", 2), ("point", "<i8")])
            # points are numbered from 1, as COLMAP does
            rows["xy"], rows["point"] = image.xy, np.where(image.points < 0, -1, image.points + 1)
            file.write(rows.tobytes())
            for index in np.flatnonzero(image.points != NO_POINT):
                tracks[image.points[index]].append((number, int(index)))
    with (folder / "points3D.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.xyz)))
        for row, track in enumerate(tracks):
            values = (*model.xyz[row], *model.rgb[row], model.error[row], len(track))
            file.write(struct.pack("<Q3d3BdQ", row + 1, *values))
            file.write(np.array(track, dtype="<i4").tobytes())


def object_points(
    model: SparseModel,
    views: Mapping[int, Camera],
    masks: Mapping[int, NDArray[np.uint8]],
) -> SparsePoints:
    """Let every view that sees a point vote whether the point's projection lies in its mask.

    ``views`` and ``masks`` [H, W] (255 = object) go by image number and describe the same image
    plane. A projection outside the image votes against.
    """
    numbers, points, _ = model.observations()
    votes, seen = np.zeros(len(model.xyz)), np.zeros(len(model.xyz), dtype=np.int32)
    for number, mask in masks.items():
        rows = points[numbers == number]
        np.add.at(seen, rows, 1)
        np.add.at(votes, rows, inside(mask, *views[number].project(model.xyz[rows])))
    share = np.divide(votes, seen, out=np.zeros_like(votes), where=seen > 0)
    return SparsePoints(model.xyz, model.rgb, share.astype(np.float32), seen)


def inside(mask: NDArray[np.uint8], pixels: Array, depths: Array) -> NDArray[np.bool_]:
    """Say for each projection [N, 2] with depth [N] whether it falls on an object pixel."""
    height, width = mask.shape
    with np.errstate(invalid="ignore"):
        cells = np.floor(np.nan_to_num(pixels, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(np.int64)
    ok = (depths > 0) & (cells >= 0).all(axis=1) & (cells < [width, height]).all(axis=1)
    hit = np.zeros(len(pixels), dtype=bool)
    hit[ok] = mask[cells[ok, 1], cells[ok, 0]] > 0
    return hit


def on_object(points: SparsePoints, share: float = OBJECT_SHARE) -> SparsePoints:
    """Keep the points that at least ``share`` of the views that see them place on the object."""
    # float32 shares such as 4/5 lie a hair beside the float64 threshold
    keep = points.object_share >= np.float32(share)
    return SparsePoints(
        points.xyz[keep], points.rgb[keep], points.object_share[keep], points.views_seen[keep]
    )


def write_ply(points: SparsePoints, path: Path) -> None:
    """Write points as a binary PLY with positions, colours and the share of object votes."""
    layout = [("xyz", "<f4", 3), ("rgb", "u1", 3), ("object_share", "<f4")]
    rows = np.zeros(len(points.xyz), dtype=layout)
    rows["xyz"], rows["rgb"], rows["object_share"] = points.xyz, points.rgb, points.object_share
    names = [f"float {n}" for n in "xyz"] + [f"uchar {n}" for n in ("red", "green", "blue")]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property {name}" for name in [*names, "float object_share"]] + ["end_header", ""]
    path.write_bytes("\n".join(header).encode() + rows.tobytes())


class _Reader:
    """Takes numbers from a binary file in order; running past the end is an InputError."""

    def __init__(self, path: Path) -> None:
        try:
            self.data = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: expected a readable COLMAP model: {error}") from error
        self.path, self.at = path, 0

    def take(self, form: str) -> tuple[float, ...]:
        try:
            values = struct.unpack_from("<" + form, self.data, self.at)
        except struct.error as error:
            raise self.broken() from error
        self.at += struct.calcsize("<" + form)
        return values

    def array(self, dtype: np.dtype[np.void], count: int) -> NDArray[np.void]:
        if count < 0 or self.at + count * dtype.itemsize > len(self.data):
            raise self.broken()
        rows = np.frombuffer(self.data, dtype, count, self.at)
        self.at += count * dtype.itemsize
        return rows

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise self.broken()
        raw, self.at = self.data[self.at : end], end + 1
        return raw.decode("utf-8", errors="replace")

    def broken(self) -> InputError:
        found = f"found the end of the file at byte {len(self.data)}"
        return InputError(f"{self.path}: expected a whole COLMAP model, {found}")


def _read_cameras(path: Path) -> dict[int, ColmapCamera]:
    reader = _Reader(path)
    names = {code: name for name, (code, _) in MODELS.items()}
    cameras = {}
    for _ in range(int(reader.take("Q")[0])):
        number, code, width, height = (int(v) for v in reader.take("iiQQ"))
        if code not in names:
            known = ", ".join(MODELS)
            raise InputError(f"{path}: expected a camera model of {known}; found number {code}")
        params = reader.take(f"{MODELS[names[code]][1]}d")
        cameras[number] = ColmapCamera(names[code], width, height, params)
    return cameras


def _read_images(path: Path, ids: NDArray[np.int64]) -> dict[int, SparseImage]:
    reader = _Reader(path)
    order = np.argsort(ids)
    layout = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
    images = {}
    for _ in range(int(reader.take("Q")[0])):
        number, *pose, camera = reader.take("i7di")
        name, rows = reader.text(), reader.array(layout, int(reader.take("Q")[0]))
        seen = np.isin(rows["point"], ids)
        points = np.full(len(rows), NO_POINT, dtype=np.int64)
        points[seen] = order[np.searchsorted(ids, rows["point"][seen], sorter=order)]
        rotation, translation = rotation_of(np.array(pose[:4])), np.array(pose[4:])
        images[int(number)] = SparseImage(
            name, int(camera), rotation, translation, rows["xy"].astype(np.float64), points
        )
    return images


def _read_points(path: Path) -> tuple[NDArray[np.int64], Array, NDArray[np.uint8], Array]:
    reader = _Reader(path)
    element = np.dtype([("image", "<i4"), ("index", "<i4")])
    rows = []
    for _ in range(int(reader.take("Q")[0])):
        rows.append(reader.take("Q3d3Bd"))
        reader.array(element, int(reader.take("Q")[0]))
    table = np.array(rows, dtype=np.float64).reshape(-1, 8)
    rgb = table[:, 4:7].astype(np.uint8)
    return table[:, 0].astype(np.int64), table[:, 1:4].copy(), rgb, table[:, 7].copy()
