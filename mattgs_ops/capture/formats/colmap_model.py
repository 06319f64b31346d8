"""COLMAP's sparse models on disk, binary or text, as plain numpy arrays: one reader, one writer.

File layout: COLMAP's documentation, "Output Format" (little-endian). Models of COLMAP 3.12 and
newer have ``rigs`` and ``frames`` beside these files; images still carry their own poses, rig or
not, so that nothing else need be read.

Why not pycolmap: a user's model comes from outside, and on damaged files COLMAP aborts its process
where this reader names file and byte; and loaded beside PyTorch or Pillow it has crashed them.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import quaternion_of, rotation_of
from mattgs_ops.capture.formats.colmap_cameras import (
    MODELS,
    NAMES,
    UNREAD,
    ColmapCamera,
    checked,
    unread,
)
from mattgs_ops.capture.sparse import NO_POINT, SparseImage, SparseModel
from mattgs_ops.errors import InputError

Array = NDArray[np.float64]
PARTS = ("cameras", "images", "points3D")
FARTHEST, SHORTEST = 1e12, 1e-6  # of a pose's numbers; beyond, they were never a pose
_POINT2D = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
_TRACK_ELEMENT = np.dtype([("image", "<i4"), ("index", "<i4")])
# what each image's second line repeats in a text model
_POINT2D_FIELDS = 3


def model_files(folder: Path) -> list[Path]:
    """Return the files of the model in ``folder``, points last; binary goes before text.

    Raises :class:`InputError` when cameras or images are missing; points may be.
    """
    for suffix in (".bin", ".txt"):
        files = [folder / f"{part}{suffix}" for part in PARTS]
        if files[0].is_file() and files[1].is_file():
            return [path for path in files if path.is_file()]
    raise InputError(f"{folder}: expected cameras and images as .bin or as .txt")


def read_model(folder: Path, *, with_points: bool = True) -> SparseModel:
    """Read a model; without points, no image has any.

    Raises :class:`InputError` naming the file and the trouble: missing, cut short, damaged, or with
    a camera model that is not read.
    """
    cameras, images, *rest = model_files(folder)
    text = cameras.suffix == ".txt"
    try:
        points = _Points()
        if with_points and rest:
            points = (_points_text if text else _points_binary)(rest[0])
        found = dict((_cameras_text if text else _cameras_binary)(cameras))
        posed = dict((_images_text if text else _images_binary)(images, points))
    except (ValueError, IndexError, OSError, OverflowError) as trouble:
        raise InputError(
            f"{folder}: damaged COLMAP model ({trouble}); export it again"
        ) from trouble
    for image in posed.values():
        if image.camera not in found:
            raise InputError(
                f"{images}: {image.name} refers to camera {image.camera}, which is not there"
            )
    return SparseModel(found, posed, points.xyz, points.rgb, points.error)


def write_model(model: SparseModel, folder: Path) -> None:
    """Write COLMAP's binary model into ``folder``, which is created."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "cameras.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.cameras)))
        for number, camera in sorted(model.cameras.items()):
            code = MODELS[camera.model].number
            file.write(struct.pack("<iiQQ", number, code, camera.width, camera.height))
            file.write(struct.pack(f"<{len(camera.params)}d", *camera.params))
    tracks: list[list[tuple[int, int]]] = [[] for _ in range(len(model.xyz))]
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.images)))
        for number, image in sorted(model.images.items()):
            pose = (*quaternion_of(image.rotation), *image.translation)
            file.write(struct.pack("<i7di", number, *pose, image.camera))
            file.write(image.name.encode() + b"\0" + struct.pack("<Q", len(image.xy)))
            rows = np.zeros(len(image.xy), dtype=_POINT2D)
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


@dataclass(frozen=True)
class _Points:
    """Points by COLMAP's ``numbers`` [P], in the file's order; none by default."""

    numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    rgb: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), dtype=np.uint8))
    error: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def order(self) -> NDArray[np.int64]:
        return np.argsort(self.numbers)

    def rows(self, seen: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows [K] of the points numbered ``seen`` [K], ``NO_POINT`` if none."""
        out = np.full(len(seen), NO_POINT, dtype=np.int64)
        known = np.isin(seen, self.numbers)
        out[known] = self.order[np.searchsorted(self.numbers, seen[known], sorter=self.order)]
        return out


class _Reader:
    """Takes numbers from a binary file in order; running past the end is an InputError."""

    def __init__(self, path: Path) -> None:
        self.data = path.read_bytes()
        self.path, self.at = path, 0

    def take(self, form: str) -> tuple[float, ...]:
        try:
            values = struct.unpack_from("<" + form, self.data, self.at)
        except struct.error as error:
            raise self.broken() from error
        self.at += struct.calcsize("<" + form)
        return values

    def array(self, dtype: np.dtype[np.void], count: int) -> NDArray[np.void]:
        if self.at + count * dtype.itemsize > len(self.data):
            raise self.broken()
        rows = np.frombuffer(self.data, dtype, count, self.at)
        self.at += count * dtype.itemsize
        return rows

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise self.broken()
        raw, self.at = self.data[self.at : end], end + 1
        return raw.decode("utf-8")

    def broken(self) -> InputError:
        return InputError(
            f"{self.path}: damaged or cut short: what byte {self.at} announces reaches beyond the "
            f"end of the file at byte {len(self.data)}; export the COLMAP model again"
        )


def _cameras_binary(path: Path) -> Iterator[tuple[int, ColmapCamera]]:
    reader = _Reader(path)
    for _ in range(int(reader.take("Q")[0])):
        number, code, width, height = (int(v) for v in reader.take("iiQQ"))
        if code not in NAMES:
            raise unread(UNREAD.get(code, f"with number {code}"), str(path))
        params = reader.take(f"{len(MODELS[NAMES[code]].parameters)}d")
        yield number, checked(ColmapCamera(NAMES[code], width, height, params), str(path))


def _cameras_text(path: Path) -> Iterator[tuple[int, ColmapCamera]]:
    for line in filter(None, _data_lines(path)):
        number, model, width, height, *params = line.split()
        if model not in MODELS:
            raise unread(model, str(path))
        camera = ColmapCamera(model, int(width), int(height), tuple(float(p) for p in params))
        yield int(number), checked(camera, str(path))


def _images_binary(path: Path, points: _Points) -> Iterator[tuple[int, SparseImage]]:
    reader = _Reader(path)
    for _ in range(int(reader.take("Q")[0])):
        number, *pose, camera = reader.take("i7di")
        name, rows = reader.text(), reader.array(_POINT2D, int(reader.take("Q")[0]))
        xy, seen = rows["xy"].astype(np.float64), rows["point"].astype(np.int64)
        yield int(number), _image(name, int(camera), np.array(pose), xy, points.rows(seen))


def _images_text(path: Path, points: _Points) -> Iterator[tuple[int, SparseImage]]:
    lines = iter(_data_lines(path))
    for line in lines:
        if not line:  # further blank lines between images
            continue
        number, *pose, camera, name = line.split(maxsplit=9)
        seconds = next(lines, "").split()  # the second line lists 2D points, and may be empty
        table = np.array(seconds, dtype=np.float64).reshape(-1, _POINT2D_FIELDS)
        seen = table[:, 2].astype(np.int64)
        numbers = np.array([float(value) for value in pose])
        yield int(number), _image(name, int(camera), numbers, table[:, :2], points.rows(seen))


def _image(
    name: str, camera: int, pose: Array, xy: Array, points: NDArray[np.int64]
) -> SparseImage:
    """Make an image of its quaternion and translation, ``pose`` [7]."""
    largest = np.abs(pose).max()
    if not (np.isfinite(largest) and largest < FARTHEST and np.abs(pose[:4]).max() > SHORTEST):
        raise ValueError(f"{name}: its pose {pose.tolist()} is none")
    return SparseImage(name, camera, rotation_of(pose[:4]), pose[4:], xy, points)


def _points_binary(path: Path) -> _Points:
    reader = _Reader(path)
    numbers, rows = [], []
    for _ in range(int(reader.take("Q")[0])):
        numbers.append(int(reader.take("q")[0]))
        rows.append(reader.take("3d3Bd"))
        reader.array(_TRACK_ELEMENT, int(reader.take("Q")[0]))
    return _points(numbers, np.array(rows, dtype=np.float64).reshape(-1, 7))


def _points_text(path: Path) -> _Points:
    rows = [line.split(maxsplit=8)[:8] for line in _data_lines(path) if line]
    numbers = [int(row[0]) for row in rows]
    return _points(numbers, np.array([row[1:] for row in rows], dtype=np.float64).reshape(-1, 7))


def _points(numbers: list[int], table: Array) -> _Points:
    """Split rows of position, colour and error."""
    rgb = np.clip(table[:, 3:6], 0, 255).astype(np.uint8)
    return _Points(np.array(numbers, dtype=np.int64), table[:, :3].copy(), rgb, table[:, 6].copy())


def _data_lines(path: Path) -> list[str]:
    lines = path.read_bytes().decode("utf-8").split("\n")  # nothing else ends a line for COLMAP
    return [line.strip() for line in lines if not line.startswith("#")]
