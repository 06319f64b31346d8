"""Splats of a whole scene after a short training, in memory: nothing is written, nothing timed.

Votes need surfaces and no experiment: plain 3DGS on the photos as they are, without
checkpoints, curves or calibration.
"""

from dataclasses import replace

import torch
from typing_extensions import override

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import TrainConfig
from mattgs_ops.method import MethodConfig
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.photos import store_views
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.initialise import initial_splats, scene_extent, starting_points
from mattgs_ops.splat.training.loop import Callback, run_steps
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.trainer import StepResult, Trainer

TOLD_EVERY = 50  # steps between two reports of progress


def train_surfaces(
    scene: Scene,
    *,
    iterations: int,
    resolution: int,
    seed: int = 0,
    threads: int = 1,
    progress: Progress = no_progress,
) -> Splats:
    """Train on all registered photos, test views too, and return the splats.

    ``resolution`` is the longest side in pixels. Same seed, same splats, whatever the number of
    threads. Raises what reading photos and a step of training raise.
    """
    config, method = TrainConfig(), MethodConfig()
    with torch.no_grad():
        views = [replace(view, split="train") for view in scene.views if view.camera is not None]
        stored = store_views(views, "original", resolution)
        extent = scene_extent([view.camera for view in stored])
        schedule = Schedule.of(config, iterations, extent)
        trainer = Trainer(stored, "original", method, config, schedule, extent, threads)
        points = starting_points(scene.points(), stored, "original", seed)
        state = TrainingState.start(initial_splats(points.at_most(config.max_splats, seed)), seed)
        run_steps(trainer, state, [_Told(iterations, progress)])
    return state.splats


class _Told(Callback):
    """Reports progress now and then."""

    def __init__(self, iterations: int, progress: Progress) -> None:
        self._iterations, self._progress = iterations, progress

    @override
    def on_step_end(self, state: TrainingState, result: StepResult) -> None:
        if state.step % TOLD_EVERY == 0 or state.step == self._iterations:
            self._progress(state.step, self._iterations, f"{len(state.splats)} splats")
