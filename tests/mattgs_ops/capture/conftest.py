"""Captures written to disk for tests."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mattgs_ops.capture.camera import Camera, Intrinsics, rotation_of
from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.prepare import prepare
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.capture.sparse import SparseImage, SparseModel
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError

WIDTH, HEIGHT = 48, 36
SPARSE_SIZE = (64, 48)
SPARSE_INTRINSICS = Intrinsics(*SPARSE_SIZE, 60.0, 61.0, 31.5, 24.5)
NAMES = [f"IMG_{i:02}.png" for i in range(10)]


def picture(seed: int, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    rgb = np.random.default_rng(seed).integers(0, 256, (height, width, 3))
    return np.asarray(rgb, dtype=np.uint8)


def disc() -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.where((x - 24) ** 2 + (y - 18) ** 2 < 100, 255, 0).astype(np.uint8)


def write_photos(folder: Path, names: list[str] = NAMES) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for seed, name in enumerate(names):
        Image.fromarray(picture(seed)).save(folder / name)
    return folder


def write_masks(folder: Path, mask: np.ndarray, form: str = "{name}.png") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name in NAMES:
        Image.fromarray(mask).save(folder / form.format(name=name, stem=Path(name).stem))


def run(path: Path, out: Path, **options: Any) -> PreparedCapture:
    keys = {key: options.pop(key) for key in ("kind", "masks") if key in options}
    options = {"test_every": 4} | options
    return prepare(CaptureConfig(name="thing", path=path, **keys), out, **options)


def refusal(path: Path, out: Path, **options: Any) -> str:
    with pytest.raises(InputError) as error:
        run(path, out, **options)
    assert not out.exists(), "nothing may be written when the input is refused"
    return str(error.value)


def pixels(path: Path | None) -> np.ndarray:
    assert path is not None
    with Image.open(path) as image:
        return np.asarray(image)


def write_cutouts(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for seed, name in enumerate(NAMES):
        Image.fromarray(np.dstack([picture(seed), disc()])).save(folder / name)


def write_transforms(folder: Path, names: list[str] = NAMES, **changes: Any) -> Path:
    frames = [
        {"file_path": f"images/{name}", "transform_matrix": np.eye(4).tolist()} for name in names
    ]
    data = {"w": WIDTH, "h": HEIGHT, "fl_x": 50.0, "fl_y": 50.0, "cx": 24.0, "cy": 18.0}
    write_photos(folder / "images")
    (folder / "transforms.json").write_text(json.dumps(data | {"frames": frames} | changes))
    return folder


def write_colmap(folder: Path, names: list[str]) -> Path:
    write_photos(folder / "images")
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text(f"1 SIMPLE_PINHOLE {WIDTH} {HEIGHT} 50 24 18\n")
    rows = [f"{i + 1} 1 0 0 0 0 0 {i} 1 {name}\n\n" for i, name in enumerate(names)]
    (model / "images.txt").write_text("".join(rows))
    return folder


@pytest.fixture
def model() -> SparseModel:
    """Three images of five points; the second image also has a key point without a point."""
    rng = np.random.default_rng(3)
    xyz = rng.uniform(-0.4, 0.4, (5, 3)) + np.array([0, 0, 4])
    images = {}
    for number, seen in ((1, [0, 1, 2, 3, 4]), (2, [3, 1, -1]), (7, [4, 0, 2])):
        rotation = rotation_of(np.array([1, *rng.normal(0, 0.05, 3)]))
        camera = Camera(SPARSE_INTRINSICS, rotation, rng.normal(0, 0.1, 3))
        points = np.array(seen)
        xy = np.where(points[:, None] < 0, 5.25, camera.project(xyz[points])[0])
        name = f"IMG ü {number}.jpg.png"
        images[number] = SparseImage(name, 4, camera.rotation, camera.translation, xy, points)
    i = SPARSE_INTRINSICS
    camera4 = ColmapCamera("PINHOLE", *SPARSE_SIZE, (i.fx, i.fy, i.cx, i.cy))
    rgb = rng.integers(0, 256, (5, 3), dtype=np.uint8)
    return SparseModel({4: camera4}, images, xyz, rgb, rng.random(5))
