"""Train splats for one experiment: a scene in, a folder with the splats out.

The folder holds ``splats.ply``, ``training.json``
(:mod:`mattgs_ops.splat.files.training_report`), ``curve.csv`` (:mod:`curve`), ``start.npz`` where
the method chose among the starting points, ``pruned.npz`` where it removed splats later,
``exposures.json`` (:mod:`mattgs_ops.splat.exposure`) where photos have an exposure of their own
and, while it runs, ``checkpoint.npz``; a killed run goes on from there by itself, and one that was
killed after its end is found finished. Training reads the registered training views and the sparse
points, nothing of the test views.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.method import MethodConfig
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.splat.exposure import Exposures
from mattgs_ops.splat.files.ply import read_ply, write_ply
from mattgs_ops.splat.files.training_report import SCHEMA, TrainingReport
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.photos import background_colour, size_at, store_views
from mattgs_ops.splat.ssim import SSIM_WINDOW
from mattgs_ops.splat.torch_threads import torch_threads
from mattgs_ops.splat.training import checkpoint
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.initialise import (
    FEWEST_POINTS,
    StartingPoints,
    initial_splats,
    scene_extent,
    starting_points,
)
from mattgs_ops.splat.training.loop import (
    CheckpointWriter,
    CurveWriter,
    ProgressReport,
    SpeedMeasurement,
    clocks,
    run_steps,
    seconds_since,
)
from mattgs_ops.splat.training.report import loss_terms, memory_bound, peak_memory
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.trainer import Trainer

PLY = "splats.ply"
START = "start.npz"  # starting points [P, 3] and which were kept [P], where attention chose
PRUNED = "pruned.npz"  # splats that the method removed: centres [K, 3], step of each [K]
FEWEST_VIEWS = 2


@dataclass(frozen=True)
class Experiment:
    """What is trained, and on what; ``resolution`` is the longest side in pixels."""

    scene: Scene
    condition: Condition
    method: MethodConfig
    config: TrainConfig
    iterations: int
    resolution: int
    seed: int

    def views(self) -> tuple[View, ...]:
        """Return the registered training views. Raises :class:`StageError` for too few."""
        views = self.scene.registered("train")
        if len(views) < FEWEST_VIEWS:
            raise StageError(
                f"scene {self.scene.name}: expected {FEWEST_VIEWS} registered training views at "
                f"least, found {len(views)}"
            )
        return views

    def digest(self) -> str:
        """Return SHA-256 of all that decides the result: files, parameters and the seed."""
        files = [self.scene.folder / "scene.json", self.scene.folder / "points.npz"]
        for view in self.views():
            files += [view.photo] if view.mask is None else [view.photo, view.mask]
        parameters = {
            "condition": str(self.condition),
            "method": self.method.model_dump(mode="json"),
            "config": self.config.model_dump(mode="json", exclude={"checkpoint_every"}),
            "iterations": self.iterations,
            "resolution": self.resolution,
            "seed": self.seed,
        }
        missing = [path for path in files if not path.is_file()]
        if missing:
            raise StageError(f"scene {self.scene.name}: expected the file {missing[0]}, found none")
        return checkpoint.digest(files, parameters)

    def _check_size(self) -> None:
        """Raise :class:`InputError` for views that would be too small for SSIM to be scored."""
        for view in (*self.views(), *self.scene.registered("test")):
            width, height = size_at(view.width, view.height, self.resolution)
            if min(width, height) < SSIM_WINDOW:
                raise InputError(
                    f"resolution: expected views of at least {SSIM_WINDOW} x {SSIM_WINDOW} pixels, "
                    f"as SSIM is scored in such windows, found {width} x {height} of {view.name} "
                    f"at {self.resolution}"
                )

    def trainer(self, threads: int) -> tuple[Trainer, StartingPoints]:
        """Read the photos and the sparse points."""
        self._check_size()
        background = self.condition.background
        views = store_views(self.views(), background, self.resolution)
        extent = scene_extent([view.camera for view in views])
        mcmc = self.method.growth == "mcmc"
        schedule = Schedule.of(self.config, self.iterations, extent, mcmc=mcmc)
        points = starting_points(self.scene.points(), views, background, self.seed)
        points = points.at_most(self.config.max_splats, self.seed)  # memory is bound by that number
        trainer = Trainer(views, background, self.method, self.config, schedule, extent, threads)
        return trainer, points


def train(
    scene: Scene,
    condition: Condition,
    method: MethodConfig,
    config: TrainConfig,
    *,
    iterations: int,
    resolution: int,
    seed: int,
    out: Path,
    threads: int = 1,
    progress: Progress = no_progress,
) -> TrainingReport:
    """Train one experiment into the folder ``out``; ``resolution`` is the longest side in pixels.

    Picks up a checkpoint of the same training in ``out``, or its result. The number of threads
    never changes the result. Raises :class:`InputError` for photos that cannot be read and
    :class:`StageError` when training cannot start or breaks down, naming the step.
    """
    experiment = Experiment(scene, condition, method, config, iterations, resolution, seed)
    digest = experiment.digest()
    out.mkdir(parents=True, exist_ok=True)
    finished = _finished(out, digest)
    if finished is not None:
        (out / checkpoint.FILE).unlink(missing_ok=True)
        progress(iterations, iterations, "had ended")
        return finished
    with torch.no_grad(), torch_threads(threads):
        trainer, points = experiment.trainer(threads)
        state = checkpoint.load(out, digest)
        resumed_from = 0 if state is None else state.step
        if state is None:
            state, kept = _first_state(trainer, points, seed)
            if method.prune_initial:
                np.savez(out / START, xyz=points.xyz.astype(np.float32), kept=kept)
        bound = memory_bound(trainer.views, config.max_splats)
        progress(state.step, iterations, f"needs at most {bound:.0f} MiB beside the libraries")
        speed = SpeedMeasurement(iterations)
        curve = CurveWriter(trainer, out)
        checkpoints = CheckpointWriter(trainer, out, digest, curve)
        run_steps(trainer, state, [speed, curve, ProgressReport(trainer, progress), checkpoints])
        report = _report(experiment, trainer, state, points.source, speed, resumed_from, digest)
        _write_result(trainer, state, out)
    report.save(out)  # last: a folder with a report is finished
    (out / checkpoint.FILE).unlink(missing_ok=True)
    return report


def train_in_memory(
    experiment: Experiment, *, threads: int = 1, progress: Progress = no_progress
) -> Splats:
    """Train as :func:`train` does and return the splats; write no file and measure no speed."""
    with torch.no_grad(), torch_threads(threads):
        trainer, points = experiment.trainer(threads)
        state, _ = _first_state(trainer, points, experiment.seed)
        run_steps(trainer, state, [ProgressReport(trainer, progress)])
    return state.splats


def _finished(out: Path, digest: str) -> TrainingReport | None:
    """Return the report of this very training when it ended in ``out``, with all its splats."""
    try:
        report = TrainingReport.load(out)
        complete = report.digest == digest and len(read_ply(out / PLY)) == report.splats
    except (OSError, InputError, ValueError, KeyError, TypeError):
        return None
    return report if complete else None


def _report(
    experiment: Experiment,
    trainer: Trainer,
    state: TrainingState,
    source: str,
    speed: SpeedMeasurement,
    resumed_from: int,
    digest: str,
) -> TrainingReport:
    """Say how the training went that has just ended; scores all views for its loss terms."""
    colour = background_colour(experiment.config)
    return TrainingReport(
        schema=SCHEMA,
        iterations=experiment.iterations,
        resolution=experiment.resolution,
        seed=experiment.seed,
        threads=trainer.threads,
        views=len(trainer.views),
        splats=len(state.splats),
        starting_splats=state.counters["starting_splats"],
        starting_source=source,
        wall_seconds=state.wall_seconds,
        cpu_seconds=state.cpu_seconds,
        calibration=speed.calibration,
        laps=tuple(speed.laps.rows) if resumed_from == 0 else (),
        resumed_from=resumed_from,
        extent=trainer.extent,
        background=colour,
        schedule=asdict(trainer.schedule),
        counters=state.counters,
        loss_terms=loss_terms(trainer, state, colour),
        peak_memory_mib=peak_memory(),
        memory_bound_mib=memory_bound(trainer.views, experiment.config.max_splats),
        digest=digest,
        trained_on=tuple(view.name for view in trainer.views),
    )


def _write_result(trainer: Trainer, state: TrainingState, out: Path) -> None:
    """Write the splats, the photos' exposures, and what the method removed on the way."""
    write_ply(state.splats, out / PLY)
    if state.exposures is not None:
        state.exposures.save([view.name for view in trainer.views], out)
    if len(state.pruned):
        removed = state.pruned.numpy()
        np.savez(out / PRUNED, xyz=removed[:, :3], step=removed[:, 3].astype(np.int32))


def _first_state(
    trainer: Trainer, points: StartingPoints, seed: int
) -> tuple[TrainingState, NDArray[np.bool_]]:
    """Return the state before the first step, and which starting points [P] became splats."""
    began = clocks()
    kept = np.ones(len(points.xyz), dtype=np.bool_)
    if trainer.method.prune_initial:
        kept = trainer.attended(points, FEWEST_POINTS)
    chosen = points.keep(kept)
    seconds = seconds_since(began)
    settings = trainer.method.mcmc
    start = {"opacity": settings.start_opacity, "scale": settings.start_scale}
    splats = initial_splats(chosen, **(start if trainer.method.growth == "mcmc" else {}))
    state = TrainingState.start(splats, seed)
    if trainer.config.exposure == "affine":
        state.exposures = Exposures.identity(len(trainer.views), trainer.schedule.iterations)
    # scoring the points is part of the method, so it is part of its time
    state.wall_seconds, state.cpu_seconds = seconds
    state.counters["starting_splats"] = len(chosen.xyz)
    state.counters["removed_before_start"] = len(points.xyz) - len(chosen.xyz)
    return state, kept
