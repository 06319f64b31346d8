"""The training loop, and what happens beside its steps.

``run_steps(trainer, state, iterations, callbacks)`` steps until the end and keeps two clocks, which
run during the steps alone. Everything else is a :class:`Callback`, called between the steps: the
curve with the progress report, checkpoints, and the measurement of speed. A training that needs
none of them has no callbacks.
"""

import time
from collections.abc import Sequence
from pathlib import Path

from typing_extensions import override

from mattgs_ops.progress import Progress
from mattgs_ops.splat.training import checkpoint
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.curve import Curve, CurveRow, due
from mattgs_ops.splat.training.laps import Laps
from mattgs_ops.splat.training.trainer import StepResult, Trainer
from mattgs_ops.timing import stopwatch
from mattgs_ops.timing.calibration import calibrate

CALIBRATIONS = 10  # workloads before and after a training, beside those within it


class Callback:
    """What is called around the steps of a training; a subclass overrides what it needs."""

    def on_training_start(self, state: TrainingState) -> None:
        """Prepare before the first step of this process."""

    def on_step_start(self, state: TrainingState) -> None:
        """Act right before a step."""

    def on_step_end(self, state: TrainingState, result: StepResult) -> None:
        """Act right after a step; ``state.step`` is the step that has just ended."""

    def on_training_end(self, state: TrainingState) -> None:
        """Act after the last step."""


def run_steps(trainer: Trainer, state: TrainingState, callbacks: Sequence[Callback] = ()) -> None:
    """Step until the end of the trainer's schedule; changes ``state``, its seconds included."""
    for callback in callbacks:
        callback.on_training_start(state)
    while state.step < trainer.schedule.iterations:
        for callback in callbacks:
            callback.on_step_start(state)
        began = clocks()
        result = trainer.step(state)
        wall, cpu = seconds_since(began)
        state.wall_seconds += wall
        state.cpu_seconds += cpu
        for callback in callbacks:
            callback.on_step_end(state, result)
    for callback in callbacks:
        callback.on_training_end(state)


class SpeedMeasurement(Callback):
    """Measures how fast the training is, relative to the machine's speed at that time.

    ``calibration`` is the fixed workload's seconds, the fastest before, within and after the
    training; ``laps`` has the times of equal parts of the training (:mod:`laps`).
    """

    def __init__(self, iterations: int) -> None:
        self.laps = Laps(iterations)
        self.calibration = 0.0
        self._began = 0.0

    @override
    def on_training_start(self, state: TrainingState) -> None:
        """Time the workload."""
        self.calibration = calibrate(CALIBRATIONS)

    @override
    def on_step_start(self, state: TrainingState) -> None:
        """Start the stopwatch."""
        self._began = stopwatch.seconds()

    @override
    def on_step_end(self, state: TrainingState, result: StepResult) -> None:
        """Add the step to its lap."""
        self.laps.add(state.step, stopwatch.seconds() - self._began)

    @override
    def on_training_end(self, state: TrainingState) -> None:
        """Time the workload again."""
        fastest = self.calibration, self.laps.fastest_workload(), calibrate(CALIBRATIONS)
        self.calibration = min(fastest)


class ProgressReport(Callback):
    """Reports progress at the steps that get a row of the curve: PSNR and number of splats."""

    def __init__(self, trainer: Trainer, progress: Progress) -> None:
        self._iterations, self._progress = trainer.schedule.iterations, progress

    @override
    def on_step_end(self, state: TrainingState, result: StepResult) -> None:
        """Report where a row is due."""
        if due(state.step, self._iterations):
            count = f"{len(state.splats):,}".replace(",", " ")
            self._progress(state.step, self._iterations, f"{result.psnr:.1f} dB, {count} splats")


class CurveWriter(Callback):
    """Writes ``curve.csv``."""

    def __init__(self, trainer: Trainer, folder: Path) -> None:
        self._trainer, self._folder = trainer, folder

    @override
    def on_training_start(self, state: TrainingState) -> None:
        """Open the curve and keep its rows up to the step that the training resumes from."""
        self._curve = Curve(self._folder, state.step)
        self._last = state.step, state.wall_seconds

    @override
    def on_step_end(self, state: TrainingState, result: StepResult) -> None:
        """Add a row where one is due."""
        if not due(state.step, self._trainer.schedule.iterations):
            return
        step, seconds = self._last
        rate = (state.step - step) / max(state.wall_seconds - seconds, 1e-9)
        self._last = state.step, state.wall_seconds
        scores = result.loss, result.l1, result.ssim, result.psnr
        fixed_psnr = self._trainer.fixed_psnr(state)
        self._curve.add(CurveRow(state.step, *scores, len(state.splats), rate, fixed_psnr))

    def flush(self) -> None:
        """Write the rows that are still in memory."""
        self._curve.flush()

    @override
    def on_training_end(self, state: TrainingState) -> None:
        """Write the last rows."""
        self.flush()


class CheckpointWriter(Callback):
    """Saves a checkpoint every ``trainer.config.checkpoint_every`` steps; never where that is 0."""

    def __init__(self, trainer: Trainer, folder: Path, digest: str, curve: CurveWriter) -> None:
        self._trainer, self._folder, self._digest = trainer, folder, digest
        self._curve = curve  # its rows reach the file before the checkpoint that follows them

    @override
    def on_step_end(self, state: TrainingState, result: StepResult) -> None:
        """Save where it is due; the end needs none."""
        every = self._trainer.config.checkpoint_every
        if every and state.step % every == 0 and state.step < self._trainer.schedule.iterations:
            self._curve.flush()
            checkpoint.save(state, self._folder, self._digest)


def clocks() -> tuple[float, float]:
    """Return this process's wall and CPU clocks, seconds; only differences mean something."""
    return time.perf_counter(), time.process_time()


def seconds_since(began: tuple[float, float]) -> tuple[float, float]:
    """Return the wall and CPU seconds since ``began``."""
    wall, cpu = clocks()
    return wall - began[0], cpu - began[1]
