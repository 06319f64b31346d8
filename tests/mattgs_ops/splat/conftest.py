"""A tiny scene on disk, rendered by the engine from known splats: photos, masks, points."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import Scene, SparsePoints, Split, View
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import render

WIDTH, HEIGHT = 48, 36
VIEWS = 9
GREY = (0.4, 0.5, 0.6)


def look_at(position: np.ndarray, width: int, height: int) -> Camera:
    """Return a camera at ``position`` that looks at the origin, z of the world up."""
    forward = -position / np.linalg.norm(position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    lens = Intrinsics(width, height, width * 1.2, width * 1.2, width / 2, height / 2)
    return Camera(lens, rotation, -rotation @ position)


def ring(count: int, width: int = WIDTH, height: int = HEIGHT) -> list[Camera]:
    """Return cameras on a circle of radius 4, a little above the origin."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    places = [np.array([4 * np.cos(a), 4 * np.sin(a), 1.5 + 0.3 * np.sin(3 * a)]) for a in angles]
    return [look_at(place, width, height) for place in places]


def ball(count: int, seed: int) -> Splats:
    """Return splats of many colours in a ball of radius 1."""
    rng = np.random.default_rng(seed)
    splats = Splats.zeros(count)
    directions = rng.normal(size=(count, 3))
    radius = rng.uniform(0.2, 1, (count, 1)) ** (1 / 3)
    means = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radius
    splats.means[:] = torch.from_numpy(means)
    splats.log_scales[:] = torch.from_numpy(rng.uniform(-2.3, -1.6, (count, 3)))
    splats.quaternions[:] = torch.from_numpy(rng.normal(size=(count, 4)))
    splats.opacity_logits[:] = 3.0
    splats.sh_dc[:] = torch.from_numpy(rng.uniform(-1.7, 1.7, (count, 3)))
    return splats


@pytest.fixture(scope="session")
def make_splats() -> Callable[[int, int], Splats]:
    return ball


@pytest.fixture(scope="session")
def make_cameras() -> Callable[..., list[Camera]]:
    return ring


@pytest.fixture
def tiny_scene(tmp_path: Path) -> Scene:
    """Nine views of a ball before grey; every eighth is held out."""
    folder = tmp_path / "scene"
    (folder / "photos").mkdir(parents=True)
    (folder / "masks").mkdir()
    truth = ball(150, seed=1)
    views = []
    for index, camera in enumerate(ring(VIEWS)):
        shot = render(truth, camera, GREY)
        name = f"{index:02d}.jpg"
        photo, mask = folder / "photos" / f"{name}.png", folder / "masks" / f"{name}.png"
        pixels = (shot.image.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
        cv2.imwrite(str(photo), pixels[:, :, ::-1])
        cv2.imwrite(str(mask), np.where(shot.alpha.numpy() > 0.5, 255, 0).astype(np.uint8))
        split: Split = "test" if index % 8 == 0 else "train"
        views.append(View(name, split, WIDTH, HEIGHT, photo, mask, camera))
    rng = np.random.default_rng(2)
    near = truth.means.numpy().astype(np.float64) + rng.normal(0, 0.02, (150, 3))
    rgb = np.clip((0.2821 * truth.sh_dc.numpy() + 0.5) * 255, 0, 255).astype(np.uint8)
    scene = Scene("ball", folder, tuple(views), {"mode": "shared"})
    scene.save(SparsePoints(near, rgb, np.ones(150, np.float32), np.full(150, 9, dtype=np.int32)))
    return scene
