"""Curves are in MLflow while the training runs, once each, and a broken registry costs nothing."""

import logging
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.store.store import Store
from tasks.registry import runs
from tasks.registry.live_curves import Expected, following, read_points
from tasks.registry.record import promoted, record, record_summary
from tasks.registry.run_of_row import TRAINING_TAG
from tasks.stages.process import StageJob
from tasks.stages.stage import Place
from tests.tasks.waiting import wait_for

TITLE = "train ball nobg-ours seed 0"
HEAD = "step,loss,fixed_psnr,splats,steps_per_second\n"
PATIENCE = 60  # seconds that a busy machine may take


def row() -> dict[str, Any]:
    return {
        "benchmark": "small", "capture": "ball", "condition": "nobg-ours", "background": "nobg",
        "method": "ours", "seed": 0, "iterations": 10, "resolution": 32, "status": "running",
        "reason": None, "metrics": {}, "per_view": [], "provenance": {"config_digest": "c"},
    }  # fmt: skip


@pytest.fixture
def place(tmp_path: Path, fresh_registry: Path) -> Place:
    shutil.copy(fresh_registry, tmp_path / "mlflow.db")
    return Place(tmp_path, "small")


KEY = "train/0123"


def leave(place: Place, key: str) -> Path:
    """Return the work folder of a training whose job lies there; at work or killed."""
    folder = place.out / "work" / key
    folder.mkdir(parents=True)
    place.logs.mkdir(exist_ok=True)
    name = "train-ball-nobg-ours-seed-0"
    last = key.rpartition("/")[2]
    job = StageJob(TITLE, "a:b", {}, folder, place.logs / f"{name}-{last}.log",
                   place.status / f"{name}.json", 1, 60.0, key=key)  # fmt: skip
    job.save(place.logs / f"{name}-{last}.job.json")
    return folder


@pytest.fixture
def work(place: Place) -> Iterator[Path]:
    """Return the work folder of a training that seems to run: its key is locked."""
    with Store(place.store).lock(KEY):
        yield leave(place, KEY)


def uri_of(place: Place) -> str:
    return f"sqlite:///{place.out / 'mlflow.db'}"


def history(place: Place, run: str, name: str) -> list[tuple[int, float]]:
    from mlflow.tracking import MlflowClient

    found = MlflowClient(tracking_uri=uri_of(place)).get_metric_history(run, name)
    return sorted((metric.step, metric.value) for metric in found)


def only_run(place: Place) -> Any:
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=uri_of(place))
    experiment = client.get_experiment_by_name("small")
    runs = client.search_runs([experiment.experiment_id]) if experiment else []
    return runs[0] if runs else None


def test_points_arrive_while_the_training_runs_and_only_once(place: Place, work: Path) -> None:
    curve = work / "curve.csv"
    curve.write_text(HEAD + "1,0.5,10,100,5\n2,0.4,11,100,5\n")
    with following(place, uri_of(place), {TITLE: Expected(row(), {"iterations": 10})}, every=0.05):
        wait_for(lambda: only_run(place) is not None)
        run_id = only_run(place).info.run_id
        wait_for(lambda: len(history(place, run_id, "curve_loss")) == 2)
        assert only_run(place).info.status == "RUNNING"
        assert only_run(place).data.params["iterations"] == "10"
        with curve.open("a") as file:
            file.write("3,0.3,12,120,5\n4,0.2")  # the last line is not whole yet
        wait_for(lambda: len(history(place, run_id, "curve_loss")) == 3)
    whole = [*read_points(curve), {"step": 4.0, "loss": 0.2, "fixed_psnr": 13.0}]
    done = row() | {"status": "finished", "metrics": {"psnr": 13.0}}
    experiment = runs.open_benchmark(uri_of(place), "small", None)
    again = runs.record(
        uri_of(place), experiment, done, parameters={"iterations": 10}, curve=whole, training=KEY
    )
    assert again == run_id
    assert history(place, run_id, "curve_loss") == [(1, 0.5), (2, 0.4), (3, 0.3), (4, 0.2)]
    assert history(place, run_id, "curve_fixed_psnr")[-1] == (4, 13.0)
    assert only_run(place).info.status == "FINISHED"


def test_what_a_killed_training_left_is_nobodys_curve(place: Place, work: Path) -> None:
    """Another code's training of the same title was killed: its job and its curve still lie there.

    The training at work must have a run with its own points and no others.
    """
    (leave(place, "train/dead") / "curve.csv").write_text(
        HEAD + "1,9,1,1,1\n2,9,1,1,1\n9,9,1,1,1\n"
    )
    (work / "curve.csv").write_text(HEAD + "1,0.5,10,100,5\n2,0.4,11,100,5\n")
    with following(place, uri_of(place), {TITLE: Expected(row(), {})}, every=0.05):
        wait_for(lambda: only_run(place) is not None)
        run_id = only_run(place).info.run_id
        wait_for(lambda: len(history(place, run_id, "curve_loss")) == 2)
    assert history(place, run_id, "curve_loss") == [(1, 0.5), (2, 0.4)]
    assert only_run(place).data.tags[TRAINING_TAG] == KEY


def test_trainings_of_other_benchmarks_and_strangers_are_left_alone(
    place: Place, work: Path
) -> None:
    (work / "curve.csv").write_text(HEAD + "1,0.5,10,100,5\n")
    for other, expected in (
        (Place(place.out, "other"), {TITLE: Expected(row(), {})}),
        (place, {"train somebody else": Expected(row(), {})}),
    ):
        with following(other, uri_of(place), expected, every=0.02):
            time.sleep(0.3)
        assert only_run(place) is None


def test_a_registry_that_fails_costs_nothing_but_a_warning(
    place: Place, work: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (work / "curve.csv").write_text(HEAD + "1,0.5,10,100,5\n")
    (place.out / "file").write_text("")
    broken = f"sqlite:///{place.out / 'file' / 'mlflow.db'}"
    with caplog.at_level(logging.WARNING, logger="mattgs"):
        with following(place, broken, {TITLE: Expected(row(), {})}, every=0.02):
            wait_for(lambda: "not followed any more" in caplog.text)
        finished = row() | {"status": "finished"}
        assert record(place, broken, finished, {}, {}) == finished
        record_summary(place, broken, "small", [finished], place.out)
        assert promoted(broken, "small") == []
    assert "ball nobg-ours seed 0 was not logged to MLflow" in caplog.text
    assert "summary of small was not logged" in caplog.text


def test_half_a_line_of_a_curve_does_not_count(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    assert read_points(path) == []
    path.write_text("step,loss\n1,0.25\n2,0.1")
    assert read_points(path) == [{"step": 1.0, "loss": 0.25}]
