"""Trainings of the tiny scene for tests, and what they left."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.method import METHODS
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.files.training_report import TrainingReport
from mattgs_ops.splat.photos import load_view
from mattgs_ops.splat.render import render_view
from mattgs_ops.splat.training.train import train
from mattgs_ops.timing import calibration

STEPS = 60
Train = Callable[..., TrainingReport]


class KilledError(Exception):
    """Stands for the process being killed."""


@pytest.fixture
def run(tiny_scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Train:
    """Train, beside a workload that hardly takes time: steps this small are a third of it else."""
    monkeypatch.setattr(calibration, "ADDITIONS", 100)
    monkeypatch.setattr(calibration, "TABLE_FLOATS", 1 << 10)

    def run(out: str, condition: str = "nobg-3dgs", **changes: Any) -> TrainingReport:
        parsed = Condition.parse(condition)
        options: dict[str, Any] = {"iterations": STEPS, "resolution": 48, "seed": 0} | changes
        method = options.pop("method", METHODS.get(parsed.method))
        config = options.pop("config", TrainConfig(checkpoint_every=20))
        scene = options.pop("scene", tiny_scene)
        return train(scene, parsed, method, config, out=tmp_path / out, **options)

    return run


def splats_of(folder: Path) -> bytes:
    return (folder / "splats.ply").read_bytes()


def pruned_of(folder: Path) -> list[tuple[float, ...]]:
    """Return step and centre of every splat that the method removed."""
    if not (folder / "pruned.npz").is_file():
        return []
    with np.load(folder / "pruned.npz") as told:
        rows = zip(told["step"].tolist(), told["xyz"].tolist(), strict=True)
        return [(step, *xyz) for step, xyz in rows]


def held_out_psnr(scene: Scene, condition: str, folder: Path, *, inside: bool = False) -> float:
    """PSNR of the held-out views, or of the object's pixels alone."""
    splats = read_ply(folder / "splats.ply")
    errors = []
    for view in scene.registered("test"):
        truth = load_view(view, Condition.parse(condition).background, 48)
        shown = render_view(splats, truth.camera) / 255.0
        chosen = truth.mask > 0.5 if inside else np.ones_like(truth.mask, bool)
        errors.append(((shown - truth.image)[chosen] ** 2).mean())
    return float(-10 * np.log10(np.mean(errors)))
