"""A tiny scene and its splats, for scores."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import Scene, SparsePoints, Split, View
from mattgs_ops.config import Condition
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import render

WIDTH, HEIGHT = 40, 32
ORIGINAL, NOBG = Condition.parse("original-3dgs"), Condition.parse("nobg-ours")
WHITE = (1.0, 1.0, 1.0)


def ball(count: int = 60) -> Splats:
    """Make an opaque, colourful ball that fills much of the frame."""
    rng = np.random.default_rng(3)
    splats = Splats.zeros(count)
    splats.means[:] = torch.from_numpy(rng.normal(size=(count, 3)) * 0.4)
    splats.log_scales[:] = math.log(0.25)
    splats.quaternions[:, 0] = 1
    splats.opacity_logits[:] = 4.0
    splats.sh_dc[:] = torch.from_numpy(rng.uniform(-1.5, 1.5, (count, 3)))
    return splats


def camera(index: int) -> Camera:
    angle = 0.15 * index
    turn = np.array(
        [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
    )
    lens = Intrinsics(WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2)
    return Camera(lens, turn, np.array([0.0, 0.0, 3.5]))


def picture(values: torch.Tensor) -> np.ndarray:
    return (values.clamp(0, 1) * 255).round().to(torch.uint8).numpy()


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """Nine views of the ball over white; the first and the last are held out."""
    folder = tmp_path / "scene"
    (folder / "photos").mkdir(parents=True)
    (folder / "masks").mkdir()
    views = []
    for index in range(9):
        name = f"{index:02}.jpg"
        shot = render(ball(), camera(index), WHITE)
        photo, mask = folder / "photos" / f"{name}.png", folder / "masks" / f"{name}.png"
        Image.fromarray(picture(shot.image)).save(photo)
        Image.fromarray(np.where(shot.alpha.numpy() > 0.5, 255, 0).astype(np.uint8)).save(mask)
        split: Split = "test" if index % 8 == 0 else "train"
        views.append(View(name, split, WIDTH, HEIGHT, photo, mask, camera(index)))
    made = Scene("ball", folder, tuple(views), {})
    made.save(
        SparsePoints(
            np.zeros((1, 3)),
            np.zeros((1, 3), np.uint8),
            np.ones(1, np.float32),
            np.ones(1, np.int32),
        )
    )
    return made


@pytest.fixture
def ply(tmp_path: Path) -> Path:
    write_ply(ball(), tmp_path / "splats.ply")
    return tmp_path / "splats.ply"


def changed(scene: Scene, index: int, **changes: object) -> Scene:
    views = list(scene.views)
    views[index] = replace(views[index], **changes)  # type: ignore[arg-type]
    return replace(scene, views=tuple(views))
