"""Readers of cameras that come with photos: nerfstudio's ``transforms.json`` and COLMAP models.

Both return :class:`PosedPhoto` rows in the project's convention (world-to-camera, x right, y down,
z forward); lens distortion is handed on, not yet removed. Only cameras and poses are read from a
COLMAP model: points and tracks are made anew from features that the project selects.
"""

import json
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Intrinsics, from_opengl
from mattgs_ops.capture.undistortion import Lens
from mattgs_ops.errors import InputError

ROTATION_TOLERANCE = 1e-3  # poses written with few digits still count as rotations
NERFSTUDIO_MODELS = ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL")
DISTORTION_KEYS = ("k1", "k2", "p1", "p2", "k3")
UNREAD_KEYS = ("k4", "k5", "k6")
# COLMAP's model ids and how many parameters each stores (src/colmap/sensor/models.h)
COLMAP_MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
}
POINT2D_BYTES = 24  # x, y as float64 and the point's id as int64


@dataclass(frozen=True)
class PosedPhoto:
    """A photo's file with its lens and pose (``x_cam = rotation @ x + translation``)."""

    photo: Path
    lens: Lens
    rotation: NDArray[np.float64]  # [3, 3]
    translation: NDArray[np.float64]  # [3]
    mask: Path | None = None


def read_nerfstudio(folder: Path) -> list[PosedPhoto]:
    """Read ``folder/transforms.json``; the frames that it lists are the capture.

    Intrinsics may stand once or per frame (``fl_x fl_y cx cy w h``, or ``camera_angle_x``).
    Raises :class:`InputError` with all problems: unreadable file, unknown camera model, missing
    intrinsics, matrices that are no rigid motion, frames whose file is absent, repeated names.
    """
    path = folder / "transforms.json"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected a readable JSON file: {error}") from error
    frames = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError(f"{path}: expected a list of objects called `frames`")
    photos, problems = [], []
    for index, frame in enumerate(frames):
        try:
            photos.append(_frame(folder, data, frame, f"{path}: frame {index}"))
        except InputError as error:
            problems.append(str(error))
    raise_all(problems)
    return _sorted_unique(photos, path)


def read_colmap(model: Path, images: Path) -> list[PosedPhoto]:
    """Read the cameras and poses of a COLMAP model, text or binary, with its photos' paths.

    Raises :class:`InputError` for a model that is not there, cut short or of an unread camera
    type, and for registered photos whose file is absent.
    """
    try:
        if (model / "cameras.bin").is_file() and (model / "images.bin").is_file():
            lenses = dict(_cameras_binary(model / "cameras.bin"))
            poses = list(_images_binary(model / "images.bin"))
        elif (model / "cameras.txt").is_file() and (model / "images.txt").is_file():
            lenses = dict(_cameras_text(model / "cameras.txt"))
            poses = list(_images_text(model / "images.txt"))
        else:
            raise InputError(f"{model}: expected cameras and images as .bin or as .txt")
    except (struct.error, ValueError, IndexError, UnicodeDecodeError) as error:
        raise InputError(f"{model}: damaged COLMAP model ({error}); export it again") from error
    photos, problems = [], []
    for name, camera_id, quaternion, translation in poses:
        if camera_id not in lenses:
            problems.append(f"{model}: {name} refers to camera {camera_id}, which is not there")
        elif not (images / name).is_file():
            problems.append(f"{images / name}: registered in {model} but missing; restore the file")
        else:
            rotation = rotation_matrix(quaternion)
            photos.append(PosedPhoto(images / name, lenses[camera_id], rotation, translation))
    raise_all(problems)
    return _sorted_unique(photos, model)


def rotation_matrix(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation [3, 3] of a quaternion wxyz of any length but zero."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def raise_all(problems: list[str], limit: int = 20) -> None:
    """Raise one :class:`InputError` that lists all problems (the first ``limit``), if any."""
    if not problems:
        return
    lines = problems[:limit]
    if len(problems) > limit:
        lines.append(f"… and {len(problems) - limit} more")
    raise InputError("\n".join(lines))


def _sorted_unique(photos: list[PosedPhoto], where: Path) -> list[PosedPhoto]:
    photos = sorted(photos, key=lambda p: p.photo.name)
    counts = Counter(photo.photo.name for photo in photos)
    twice = [name for name, count in counts.items() if count > 1]
    if twice:
        raise InputError(f"{where}: {', '.join(twice[:5])} listed more than once; rename or remove")
    return photos


def _frame(folder: Path, data: dict[str, Any], frame: dict[str, Any], where: str) -> PosedPhoto:
    values = {**data, **frame}
    photo = _resolve(folder, frame.get("file_path"), where)
    where = f"{where} ({photo.name})"
    matrix = np.array(values.get("transform_matrix"), dtype=object)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise InputError(f"{where}: `transform_matrix` must be 4x4, found shape {matrix.shape}")
    pose = np.eye(4)
    try:
        pose[:3] = matrix[:3].astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: `transform_matrix` must hold numbers: {error}") from error
    turn = pose[:3, :3]
    rigid = np.allclose(turn @ turn.T, np.eye(3), atol=ROTATION_TOLERANCE)
    if not (np.isfinite(pose).all() and rigid and np.linalg.det(turn) > 0):
        raise InputError(f"{where}: `transform_matrix` is no rigid motion (rotation, translation)")
    rotation, translation = from_opengl(pose)
    mask = values.get("mask_path")
    return PosedPhoto(
        photo,
        _frame_lens(values, where),
        rotation,
        translation,
        None if mask is None else _resolve(folder, mask, where),
    )


def _resolve(folder: Path, file_path: object, where: str) -> Path:
    if not isinstance(file_path, str) or not file_path:
        raise InputError(f"{where}: expected `file_path`, found {file_path!r}")
    path = folder / file_path
    if path.is_file():
        return path
    if not path.suffix and path.with_suffix(".png").is_file():  # NeRF-synthetic leaves it out
        return path.with_suffix(".png")
    raise InputError(f"{where}: {path} is missing; restore the file or remove the frame")


def _frame_lens(values: dict[str, Any], where: str) -> Lens:
    model = values.get("camera_model", "OPENCV")
    if model not in NERFSTUDIO_MODELS:
        expected = ", ".join(NERFSTUDIO_MODELS)
        raise InputError(f"{where}: camera model {model!r}: expected one of {expected}")
    if any(values.get(key) for key in UNREAD_KEYS):
        raise InputError(f"{where}: {', '.join(UNREAD_KEYS)} are not read; undistort the photos")
    try:
        width, height = int(values["w"]), int(values["h"])
        if "fl_x" in values:
            fx = float(values["fl_x"])
        else:
            fx = width / 2 / np.tan(float(values["camera_angle_x"]) / 2)
        fy = float(values.get("fl_y", fx))
        cx, cy = float(values.get("cx", width / 2)), float(values.get("cy", height / 2))
        k1, k2, p1, p2, k3 = (float(values.get(key, 0.0)) for key in DISTORTION_KEYS)
    except KeyError as error:
        raise InputError(f"{where}: intrinsics incomplete: {error} is missing") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: intrinsics must be numbers: {error}") from error
    if not (min(width, height) > 0 and fx > 0 and fy > 0):
        raise InputError(f"{where}: expected positive w, h, fl_x, fl_y")
    distortion = (0.0,) * 5 if "PINHOLE" in model else (k1, k2, p1, p2, k3)
    return Lens(Intrinsics(width, height, fx, fy, cx, cy), distortion)


def _colmap_lens(model: str, width: int, height: int, p: list[float], where: Path) -> Lens:
    """Order of parameters: f or fx fy, cx, cy, then the distortion's."""
    if model not in {name for name, _ in COLMAP_MODELS.values()}:
        expected = ", ".join(name for name, _ in COLMAP_MODELS.values())
        raise InputError(f"{where}: camera model {model}: expected one of {expected}; undistort")
    if model in ("PINHOLE", "OPENCV"):
        fx, fy, cx, cy, *rest = p
    else:
        fx, cx, cy, *rest = p
        fy = fx
    k1, k2, p1, p2 = [*rest, 0.0, 0.0, 0.0, 0.0][:4]
    return Lens(Intrinsics(width, height, fx, fy, cx, cy), (k1, k2, p1, p2, 0.0))


PoseRow = tuple[str, int, NDArray[np.float64], NDArray[np.float64]]


def _data_lines(path: Path) -> list[str]:
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line.strip() for line in lines if not line.startswith("#")]


def _cameras_text(path: Path) -> Iterator[tuple[int, Lens]]:
    for line in filter(None, _data_lines(path)):
        camera_id, model, width, height, *numbers = line.split()
        values = [float(number) for number in numbers]
        yield int(camera_id), _colmap_lens(model, int(width), int(height), values, path)


def _images_text(path: Path) -> Iterator[PoseRow]:
    lines = _data_lines(path)
    while lines and not lines[0]:
        lines = lines[1:]
    for line in lines[::2]:  # every second line lists 2D points, and may be empty
        if not line:
            break
        fields = line.split(maxsplit=9)
        numbers = np.array([float(field) for field in fields[1:8]])
        yield fields[9], int(fields[8]), numbers[:4], numbers[4:]


def _unpack(file: BinaryIO, form: str) -> tuple[Any, ...]:
    return struct.unpack(f"<{form}", file.read(struct.calcsize(f"<{form}")))


def _cameras_binary(path: Path) -> Iterator[tuple[int, Lens]]:
    with path.open("rb") as file:
        for _ in range(_unpack(file, "Q")[0]):
            camera_id, model_id, width, height = _unpack(file, "iiQQ")
            model, count = COLMAP_MODELS.get(model_id, (f"with id {model_id}", 0))
            values = list(_unpack(file, f"{count}d"))
            yield camera_id, _colmap_lens(model, width, height, values, path)


def _images_binary(path: Path) -> Iterator[PoseRow]:
    with path.open("rb") as file:
        for _ in range(_unpack(file, "Q")[0]):
            _, *pose, camera_id = _unpack(file, "i7di")
            name = bytearray()
            while (byte := _unpack(file, "c")[0]) != b"\0":
                name += byte
            file.seek(POINT2D_BYTES * _unpack(file, "Q")[0], 1)
            numbers = np.array(pose)
            yield name.decode("utf-8"), camera_id, numbers[:4], numbers[4:]
