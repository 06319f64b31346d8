"""The loop calls its callbacks around each step and needs none of them."""

from pathlib import Path

import pytest
from typing_extensions import override

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.method import MethodConfig
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.initialise import initial_splats
from mattgs_ops.splat.training.loop import Callback, SpeedMeasurement, run_steps
from mattgs_ops.splat.training.train import Experiment, train, train_in_memory
from mattgs_ops.splat.training.trainer import StepResult

STEPS = 6


class Recorder(Callback):
    """Notes every call with the step at its time."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, int]] = []

    @override
    def on_training_start(self, state: TrainingState) -> None:
        self.calls.append(("start", state.step))

    @override
    def on_step_start(self, state: TrainingState) -> None:
        self.calls.append(("before", state.step))

    @override
    def on_step_end(self, state: TrainingState, result: StepResult) -> None:
        assert result.loss > 0
        self.calls.append(("after", state.step))

    @override
    def on_training_end(self, state: TrainingState) -> None:
        self.calls.append(("end", state.step))


@pytest.fixture
def experiment(tiny_scene: Scene) -> Experiment:
    condition = Condition.parse("nobg-3dgs")
    return Experiment(tiny_scene, condition, MethodConfig(), TrainConfig(), STEPS, 48, 0)


def started(experiment: Experiment) -> TrainingState:
    _, points = experiment.trainer(threads=1)
    return TrainingState.start(initial_splats(points), experiment.seed)


def test_callbacks_are_called_around_every_step(experiment: Experiment) -> None:
    trainer, _ = experiment.trainer(threads=1)
    recorder, state = Recorder(), started(experiment)
    run_steps(trainer, state, [recorder])
    steps = [call for k in range(STEPS) for call in (("before", k), ("after", k + 1))]
    assert recorder.calls == [("start", 0), *steps, ("end", STEPS)]


def test_the_clocks_leave_out_what_callbacks_do(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0

    class Slow(Callback):
        @override
        def on_step_start(self, state: TrainingState) -> None:
            nonlocal now
            now += 100.0

        on_training_end = on_step_start

    monkeypatch.setattr("mattgs_ops.splat.training.loop.clocks", lambda: (now, now))
    trainer, _ = experiment.trainer(threads=1)
    state = started(experiment)
    run_steps(trainer, state, [Slow()])
    assert now == 100.0 * (STEPS + 1)
    assert (state.wall_seconds, state.cpu_seconds) == (0.0, 0.0)


def test_speed_is_measured_in_laps_with_a_workload_before_and_after(experiment: Experiment) -> None:
    trainer, _ = experiment.trainer(threads=1)
    speed = SpeedMeasurement(STEPS)
    run_steps(trainer, started(experiment), [speed])
    assert speed.calibration > 0
    assert len(speed.laps.rows) == STEPS
    assert all(lap["value"] > 0 for lap in speed.laps.rows)


def test_splats_in_memory_are_those_of_the_folder(experiment: Experiment, tmp_path: Path) -> None:
    before = sorted(experiment.scene.folder.rglob("*"))
    splats = train_in_memory(experiment)
    assert sorted(experiment.scene.folder.rglob("*")) == before
    train(
        experiment.scene,
        experiment.condition,
        experiment.method,
        experiment.config,
        iterations=STEPS,
        resolution=experiment.resolution,
        seed=experiment.seed,
        out=tmp_path / "out",
    )
    for name, value in read_ply(tmp_path / "out" / "splats.ply").items():
        assert value.equal(getattr(splats, name)), name


def test_splats_in_memory_report_progress(experiment: Experiment) -> None:
    reports: list[tuple[int, int, str]] = []
    train_in_memory(experiment, progress=lambda *report: reports.append(report))
    assert reports[-1][:2] == (STEPS, STEPS)
    assert "dB" in reports[-1][2]
