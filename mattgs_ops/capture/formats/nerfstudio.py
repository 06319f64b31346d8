"""Cameras in JSON: nerfstudio's ``transforms.json``, and NeRF's own layout of one file per split.

nerfstudio: all frames in ``transforms.json``, intrinsics once or per frame (``fl_x fl_y cx cy w
h``), the split as lists of file names, sparse points in ``ply_file_path``. NeRF:
``transforms_train.json``, ``transforms_test.json`` and perhaps ``transforms_val.json``, with
``camera_angle_x`` alone and file paths without their suffix. Poses are camera-to-world in OpenGL's
axes in both; lens distortion is handed on, not yet removed.
"""

import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mattgs_ops.capture.camera import Intrinsics, from_opengl
from mattgs_ops.capture.formats.colmap_cameras import coefficients
from mattgs_ops.capture.formats.posed import PosedCapture, PosedPhoto, path_inside, raise_all
from mattgs_ops.capture.formats.split_lists import NERF_LISTS, SplitLists, listed_names
from mattgs_ops.capture.photos import FORMATS, UNREADABLE
from mattgs_ops.capture.scene import Split
from mattgs_ops.capture.undistortion import Lens
from mattgs_ops.errors import InputError

FILE = "transforms.json"
ROTATION_TOLERANCE = 1e-3  # poses written with few digits still count as rotations
PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE")
BROWN = ("OPENCV", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV")
FISHEYES = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
CAMERA_MODELS = (*PINHOLES, *BROWN, *FISHEYES)
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
# nerfstudio's k4 of OPENCV is the factor of r⁸, COLMAP's of FULL_OPENCV is another's
AMBIGUOUS = ("k4", "k5", "k6")
WIDEST = 3.1  # radians, field of view of a pinhole: π is infinitely wide
SUFFIX = ".png"  # of photos that NeRF's layout lists without one


def is_there(folder: Path) -> bool:
    """Say whether ``folder`` holds a capture of this kind."""
    return (folder / FILE).is_file() or _is_split(folder)


def read_nerfstudio(folder: Path) -> PosedCapture:
    """Read ``transforms.json`` or NeRF's files; the frames that they list are the capture.

    Raises :class:`InputError` with all problems: unreadable file, unknown camera model, missing
    intrinsics, matrices that are no rigid motion, frames whose file is absent or outside of
    ``folder``, photos listed twice, lists of photos that are none.
    """
    if not (folder / FILE).is_file() and _is_split(folder):
        return _read_split(folder)
    path = folder / FILE
    data, photos = _read(path)
    split, left_out = _listed_split(folder, data, photos, str(path))
    kept = tuple(photo for photo in photos if photo.photo not in left_out)
    return PosedCapture(kept, split, left_out, _points(folder, data, str(path)), (path,))


def _is_split(folder: Path) -> bool:
    return (folder / NERF_LISTS["train"]).is_file()


def _read_split(folder: Path) -> PosedCapture:
    """Read NeRF's layout; validation photos count only where there are no test photos."""
    paths = {kind: folder / name for kind, name in NERF_LISTS.items()}
    held_out = next((paths[k] for k in ("test", "validation") if paths[k].is_file()), None)
    if held_out is None:
        raise InputError(f"{paths['train']}: expected {NERF_LISTS['test']} beside it")
    train_data, train = _read(paths["train"])
    _, test = _read(held_out)
    photos = _sorted_unique([*train, *test], folder)
    split: dict[Path, Split] = dict.fromkeys((p.photo for p in train), "train")
    split |= dict.fromkeys((p.photo for p in test), "test")
    points = _points(folder, train_data, str(paths["train"]))
    return PosedCapture(photos, split, (), points, (paths["train"], held_out))


def _read(path: Path) -> tuple[dict[str, Any], tuple[PosedPhoto, ...]]:
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
            photos.append(_frame(path.parent, data, frame, f"{path}: frame {index}"))
        except InputError as error:
            problems.append(str(error))
    raise_all(problems)
    return data, _sorted_unique(photos, path)


def _sorted_unique(photos: list[PosedPhoto], where: Path) -> tuple[PosedPhoto, ...]:
    counts = Counter(photo.photo for photo in photos)
    twice = [path.name for path, count in counts.items() if count > 1]
    if twice:
        raise InputError(f"{where}: {', '.join(twice[:5])} listed more than once; rename or remove")
    return tuple(sorted(photos, key=lambda p: p.photo.as_posix()))


def _listed_split(
    folder: Path, data: dict[str, Any], photos: tuple[PosedPhoto, ...], where: str
) -> tuple[dict[Path, Split], tuple[Path, ...]]:
    """Return the split of nerfstudio's lists, and the photos in none of them."""
    train, validation, test = (
        _names(data.get(key), f"{where}: `{key}`")
        for key in ("train_filenames", "val_filenames", "test_filenames")
    )
    found = SplitLists(train, validation, test, where)
    if not found.any:
        return {}, ()
    return found.assign({name: p.photo for p in photos for name in listed_names(p.photo, [folder])})


def _names(value: object, where: str) -> tuple[str, ...] | None:
    """Return a list of files; None for none, or an empty one, which nerfstudio writes for none."""
    if value is None or value == []:
        return None
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise InputError(f"{where}: expected a list of file names")
    return tuple(name.removeprefix("./") for name in value)


def _points(folder: Path, data: dict[str, Any], where: str) -> Path | None:
    name = data.get("ply_file_path")
    if name is None:
        return None
    if not isinstance(name, str) or not name:
        raise InputError(f"{where}: expected `ply_file_path` to be a file's name, found {name!r}")
    path = path_inside(folder, name, f"{where}: `ply_file_path`")
    if not path.is_file():
        raise InputError(f"{where}: `ply_file_path`: {path} is missing; restore the file")
    return path


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
    posed = PosedPhoto(photo, _lens(values, photo, where), rotation, translation)
    return posed if mask is None else replace(posed, mask=_resolve(folder, mask, where))


def _resolve(folder: Path, file_path: object, where: str) -> Path:
    if not isinstance(file_path, str) or not file_path:
        raise InputError(f"{where}: expected `file_path`, found {file_path!r}")
    path = path_inside(folder, file_path.removeprefix("./"), where)
    if path.is_file():
        return path
    with_suffix = path.with_name(f"{path.name}{SUFFIX}")
    if with_suffix.is_file():
        return with_suffix
    if "\\" in file_path:  # as Windows writes paths
        return _resolve(folder, file_path.replace("\\", "/"), where)
    raise InputError(f"{where}: {path} is missing; restore the file or remove the frame")


def _lens(values: dict[str, Any], photo: Path, where: str) -> Lens:
    # instant-ngp's own scripts write the flag instead of a model
    model = values.get("camera_model") or (
        "OPENCV_FISHEYE" if values.get("is_fisheye") else "OPENCV"
    )
    if model not in CAMERA_MODELS:
        expected = ", ".join(CAMERA_MODELS)
        raise InputError(f"{where}: camera model {model!r}: expected one of {expected}")
    if model in BROWN and model != "FULL_OPENCV" and any(values.get(key) for key in AMBIGUOUS):
        raise InputError(
            f"{where}: {', '.join(AMBIGUOUS)} of camera model {model} are not read; undistort the "
            "photos"
        )
    try:
        intrinsics = _intrinsics(values, photo, where)
        given = {key: float(values.get(key) or 0.0) for key in COEFFICIENTS}
    except KeyError as error:
        raise InputError(f"{where}: intrinsics incomplete: {error} is missing") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: intrinsics must be numbers: {error}") from error
    if model in PINHOLES:
        return Lens(intrinsics)
    return Lens(intrinsics, *coefficients(given, fisheye=model in FISHEYES))


def _intrinsics(values: dict[str, Any], photo: Path, where: str) -> Intrinsics:
    """Read a pinhole; NeRF's layout leaves out the photo's size, which the photo itself tells."""
    if "w" not in values and "h" not in values and "fl_x" not in values:
        width, height = _size(photo)
    else:
        width, height = int(values["w"]), int(values["h"])
    if "fl_x" in values:
        fx = float(values["fl_x"])
    else:
        fx = _focal(values, "camera_angle_x", width, where)
    if "fl_y" in values or "camera_angle_y" not in values:
        fy = float(values.get("fl_y", fx))
    else:
        fy = _focal(values, "camera_angle_y", height, where)
    cx, cy = float(values.get("cx", width / 2)), float(values.get("cy", height / 2))
    if not (min(width, height) > 0 and fx > 0 and fy > 0 and np.isfinite([fx, fy, cx, cy]).all()):
        raise InputError(f"{where}: expected positive w, h, fl_x, fl_y")
    return Intrinsics(width, height, fx, fy, cx, cy)


def _focal(values: dict[str, Any], key: str, pixels: int, where: str) -> float:
    """Return the focal length of a field of view, in radians, over so many pixels."""
    angle = float(values[key])
    if not 0 < angle < WIDEST:
        raise InputError(f"{where}: `{key}`: expected radians from 0 to {WIDEST}, found {angle:g}")
    return pixels / 2 / math.tan(angle / 2)


def _size(photo: Path) -> tuple[int, int]:
    try:
        with Image.open(photo, formats=FORMATS) as image:
            return image.size
    except UNREADABLE as error:
        raise InputError(
            f"{photo}: cannot be read as an image; replace it by an intact copy or remove it"
        ) from error
