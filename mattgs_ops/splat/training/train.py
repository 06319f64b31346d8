"""Train splats for one experiment: a scene in, a folder with the splats out.

The folder holds ``splats.ply``, ``training.json`` (:mod:`report`), ``curve.csv`` (:mod:`curve`),
``start.npz`` where the method chose among the starting points, ``pruned.npz`` where it removed
splats later and, while it runs,
``checkpoint.npz``; a killed run goes on from there by itself, and one that was killed after its end
is found finished. Training reads the registered training views and the sparse points, nothing of
the test views.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.method import MethodConfig
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.splat.files.ply import read_ply, write_ply
from mattgs_ops.splat.photos import background_colour, store_views
from mattgs_ops.splat.training import checkpoint
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.curve import Curve, CurveRow, due
from mattgs_ops.splat.training.initialise import (
    FEWEST_POINTS,
    StartingPoints,
    initial_splats,
    scene_extent,
    starting_points,
)
from mattgs_ops.splat.training.laps import Laps
from mattgs_ops.splat.training.report import (
    SCHEMA,
    TrainingReport,
    loss_terms,
    memory_bound,
    peak_memory,
)
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.trainer import StepResult, Trainer
from mattgs_ops.timing import stopwatch
from mattgs_ops.timing.calibration import calibrate

PLY = "splats.ply"
START = "start.npz"  # starting points [P, 3] and which were kept [P], where attention chose
PRUNED = "pruned.npz"  # splats that the method removed: centres [K, 3], step of each [K]
FEWEST_VIEWS = 2
CALIBRATIONS = 50  # workloads before and after; the fastest counts


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
    views = scene.registered("train")
    if len(views) < FEWEST_VIEWS:
        raise StageError(
            f"scene {scene.name}: expected {FEWEST_VIEWS} registered training views at least, "
            f"found {len(views)}"
        )
    out.mkdir(parents=True, exist_ok=True)
    key = _digest(scene, views, condition, method, config, iterations, resolution, seed)
    known = _finished(out, key)
    if known is not None:
        (out / checkpoint.FILE).unlink(missing_ok=True)
        progress(iterations, iterations, "had ended")
        return known
    with torch.no_grad(), _threads(threads):
        stored = store_views(views, condition.background, resolution)
        extent = scene_extent([view.camera for view in stored])
        schedule = Schedule.of(config, iterations, extent)
        trainer = Trainer(stored, condition.background, method, config, schedule, extent, threads)
        points = starting_points(scene.points(), stored, condition.background, seed)
        points = points.at_most(config.max_splats, seed)  # memory is bound by that number
        state = checkpoint.load(out, key)
        resumed_from = 0 if state is None else state.step
        if state is None:
            state = _start(trainer, points, seed, out)
        bound = memory_bound(stored, config.max_splats)
        progress(state.step, iterations, f"needs at most {bound:.0f} MiB beside the libraries")
        workload = calibrate(CALIBRATIONS)
        laps = _run(trainer, state, out, key, progress)
        workload = min(workload, calibrate(CALIBRATIONS))
        colour = background_colour(config)
        report = TrainingReport(
            schema=SCHEMA,
            iterations=iterations,
            resolution=resolution,
            seed=seed,
            threads=threads,
            views=len(views),
            splats=len(state.splats),
            starting_splats=state.counters["starting_splats"],
            starting_source=points.source,
            wall_seconds=state.wall_seconds,
            cpu_seconds=state.cpu_seconds,
            calibration=workload,
            laps=tuple(laps.rows) if resumed_from == 0 else (),
            resumed_from=resumed_from,
            extent=extent,
            background=colour,
            schedule=asdict(schedule),
            counters=state.counters,
            loss_terms=loss_terms(trainer, state.splats, colour),
            peak_memory_mib=peak_memory(),
            memory_bound_mib=bound,
            digest=key,
        )
        write_ply(state.splats, out / PLY)
        if len(state.pruned):
            gone = state.pruned.numpy()
            np.savez(out / PRUNED, xyz=gone[:, :3], step=gone[:, 3].astype(np.int32))
    report.save(out)
    (out / checkpoint.FILE).unlink(missing_ok=True)
    return report


def _finished(out: Path, key: str) -> TrainingReport | None:
    """Return the report of this very training when it ended in ``out``, with all its splats."""
    try:
        report = TrainingReport.load(out)
        whole = report.digest == key and len(read_ply(out / PLY)) == report.splats
    except (OSError, InputError, ValueError, KeyError, TypeError):
        return None
    return report if whole else None


def _start(trainer: Trainer, points: StartingPoints, seed: int, out: Path) -> TrainingState:
    began = _clocks()
    kept = np.ones(len(points.xyz), dtype=np.bool_)
    if trainer.method.prune_initial:
        kept = trainer.attended(points, FEWEST_POINTS)
    chosen = points.keep(kept)
    seconds = _since(began)
    if trainer.method.prune_initial:
        np.savez(out / START, xyz=points.xyz.astype(np.float32), kept=kept)
    state = TrainingState.start(initial_splats(chosen), seed)
    # scoring the points is part of the method, so it is part of its time
    state.wall_seconds, state.cpu_seconds = seconds
    state.counters["starting_splats"] = len(chosen.xyz)
    state.counters["removed_before_start"] = len(points.xyz) - len(chosen.xyz)
    return state


def _run(trainer: Trainer, state: TrainingState, out: Path, key: str, progress: Progress) -> Laps:
    """Step until the end, with curve, checkpoints and progress outside the clock."""
    iterations = trainer.schedule.iterations
    every = trainer.config.checkpoint_every
    curve, laps = Curve(out, state.step), Laps(iterations)
    reported, reported_at = state.step, state.wall_seconds
    while state.step < iterations:
        calm, began = stopwatch.seconds(), _clocks()
        result = trainer.step(state)
        wall, cpu = _since(began)
        state.wall_seconds += wall
        state.cpu_seconds += cpu
        laps.add(state.step, stopwatch.seconds() - calm)
        if due(state.step, iterations):
            rate = (state.step - reported) / max(state.wall_seconds - reported_at, 1e-9)
            reported, reported_at = state.step, state.wall_seconds
            fixed = trainer.fixed_psnr(state.splats)
            curve.add(_row(state, result, rate, fixed))
            progress(state.step, iterations, _note(result, state))
        if every and state.step % every == 0 and state.step < iterations:
            curve.flush()
            checkpoint.save(state, out, key)
    curve.flush()
    return laps


def _row(state: TrainingState, result: StepResult, rate: float, fixed: float) -> CurveRow:
    seen = result.loss, result.l1, result.ssim, result.psnr
    return CurveRow(state.step, *seen, len(state.splats), rate, fixed)


def _note(result: StepResult, state: TrainingState) -> str:
    count = f"{len(state.splats):,}".replace(",", " ")
    return f"{result.psnr:.1f} dB, {count} splats"


def _digest(
    scene: Scene,
    views: tuple[View, ...],
    condition: Condition,
    method: MethodConfig,
    config: TrainConfig,
    iterations: int,
    resolution: int,
    seed: int,
) -> str:
    files = [scene.folder / "scene.json", scene.folder / "points.npz"]
    for view in views:
        files += [view.photo] if view.mask is None else [view.photo, view.mask]
    parameters = {
        "condition": str(condition),
        "method": method.model_dump(mode="json"),
        "config": config.model_dump(mode="json", exclude={"checkpoint_every"}),
        "iterations": iterations,
        "resolution": resolution,
        "seed": seed,
    }
    missing = [path for path in files if not path.is_file()]
    if missing:
        raise StageError(f"scene {scene.name}: expected the file {missing[0]}, found none")
    return checkpoint.digest(files, parameters)


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Let torch use ``count`` threads for the time being."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def _since(began: tuple[float, float]) -> tuple[float, float]:
    wall, cpu = _clocks()
    return wall - began[0], cpu - began[1]
