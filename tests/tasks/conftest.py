"""A small scene in a store, as structure-from-motion would have left it."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import Scene, SparsePoints, Split, View
from mattgs_ops.config import BenchmarkConfig, RunConfig
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import render
from mattgs_ops.store.keys import stage_key
from mattgs_ops.store.store import Store
from tasks.stages.stage import Artifact, Place

SIZE, VIEWS, POINTS = 40, 9, 200


@pytest.fixture(autouse=True)
def own_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the locks that silence the machine apart from those of benchmarks running beside."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path / "out", "small", RunConfig(stage_timeout=120))


@pytest.fixture
def config() -> BenchmarkConfig:
    return BenchmarkConfig.model_validate(
        {
            "name": "small",
            "captures": [{"name": "ball", "path": "/nowhere"}],
            "conditions": ["nobg-3dgs", "nobg-ours"],
            "iterations": 40,
            "resolution": SIZE,
        }
    )


@pytest.fixture
def put_scene() -> Callable[[Place], Artifact]:
    """Return a function that puts the scene into a place's store."""
    return _put_scene


def _put_scene(place: Place) -> Artifact:
    key = stage_key("sfm", "test", {}, {})
    with Store(place.store).stage(key) as slot:
        _write_scene(slot.work)
        done = slot.finish({"seconds": 1.0})
    return Artifact("sfm", done.key, done.digest, 1.0, cached=False)


def _write_scene(folder: Path) -> None:
    """Write a cloud of splats as a ring of cameras sees it; every eighth view is held out."""
    rng = np.random.default_rng(7)
    cloud = Splats.zeros(POINTS)
    cloud.means[:] = torch.from_numpy(rng.normal(0, 0.4, (POINTS, 3)))
    cloud.log_scales[:] = -2.0
    cloud.quaternions[:, 0] = 1.0
    cloud.opacity_logits[:] = 2.5
    cloud.sh_dc[:] = torch.from_numpy(rng.uniform(-1.5, 1.5, (POINTS, 3)))
    for name in ("photos", "masks"):
        (folder / name).mkdir()
    views = []
    for index in range(VIEWS):
        camera = _camera(2 * np.pi * index / VIEWS)
        shot = render(cloud, camera, (1.0, 1.0, 1.0))
        file = f"{index:02d}.jpg.png"
        pixels = (shot.image.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
        inside = np.where(shot.alpha.numpy() > 0.5, 255, 0).astype(np.uint8)
        cv2.imwrite(str(folder / "photos" / file), pixels[:, :, ::-1])
        cv2.imwrite(str(folder / "masks" / file), inside)
        split: Split = "train" if index % 8 else "test"
        paths = folder / "photos" / file, folder / "masks" / file
        views.append(View(f"{index:02d}.jpg", split, SIZE, SIZE, *paths, camera))
    rgb = np.clip((cloud.sh_dc.numpy() * 0.28 + 0.5) * 255, 0, 255).astype(np.uint8)
    share, seen = np.ones(POINTS, np.float32), np.full(POINTS, VIEWS, np.int32)
    points = SparsePoints(cloud.means.numpy().astype(np.float64), rgb, share, seen)
    Scene("ball", folder, tuple(views), {"mode": "shared"}).save(points)


def _camera(angle: float) -> Camera:
    """Look at the origin from a circle of radius 4."""
    position = 4 * np.array([np.cos(angle), np.sin(angle), 0.3])
    forward = -position / np.linalg.norm(position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    lens = Intrinsics(SIZE, SIZE, SIZE * 1.5, SIZE * 1.5, SIZE / 2, SIZE / 2)
    return Camera(lens, rotation, -rotation @ position)
