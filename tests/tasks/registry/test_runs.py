"""Rows in MLflow: nothing lost, nothing twice, readable back as it was."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from tasks.registry import run_of_row, runs, summary

PROCESSES, ROWS_EACH = 3, 4


def row(seed: int = 0, **changes: Any) -> dict[str, Any]:
    return {
        "schema": 1,
        "benchmark": "small",
        "capture": "rover",
        "condition": "nobg-ours",
        "background": "nobg",
        "method": "ours",
        "seed": seed,
        "iterations": 100,
        "resolution": 64,
        "status": "finished",
        "reason": None,
        "metrics": {"psnr": 24.5, "ssim": 0.9, "fps": None, "splats": 1200},
        "per_view": [
            {"view": "0000.jpg", "split": "test", "psnr": 24.0},
            {"view": "0008.jpg", "split": "test", "psnr": 25.0, "mask_psnr": 20.0},
        ],
        "provenance": {"code_version": "abc", "config_digest": "def", "inputs": {"photos": "1"}},
    } | changes


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("mlflow")
    uri = f"sqlite:///{folder / 'mlflow.db'}"
    runs.initialise(uri)
    return uri, folder / "artifacts"


def client(uri: str) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=uri)


def test_a_row_becomes_a_run_that_says_everything(place: tuple[str, Path], tmp_path: Path) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "one", artifacts)
    (tmp_path / "renders").mkdir()
    (tmp_path / "renders" / "0000.png").write_bytes(b"png")
    run_id = runs.record(
        uri,
        experiment,
        row(),
        parameters={"iterations": 100, "train": {"lr_scale": 5e-3}},
        curve=[{"step": 10, "loss": 0.5}, {"step": 20, "loss": 0.25}],
        files=[(tmp_path / "renders", "renders")],
    )
    run = client(uri).get_run(run_id)
    assert run.info.status == "FINISHED"
    assert run.info.run_name == "rover nobg-ours seed 0"
    metrics = {"psnr": 24.5, "ssim": 0.9, "splats": 1200.0, "curve_loss": 0.25}
    assert run.data.metrics == metrics, "a metric that was not measured is left out"
    assert run.data.params == {"iterations": "100", "train.lr_scale": "0.005"}
    assert run.data.tags["background"] == "nobg"
    history = client(uri).get_metric_history(run_id, "curve_loss")
    assert [(m.step, m.value) for m in history] == [(10, 0.5), (20, 0.25)]
    files = artifacts / "one" / run_id / "artifacts"
    assert (files / "renders" / "0000.png").read_bytes() == b"png"
    table = json.loads((files / "per_view.json").read_text())
    assert table["columns"] == ["view", "split", "psnr", "mask_psnr"]
    assert table["data"][0] == ["0000.jpg", "test", 24.0, None]


def test_rows_are_read_back_as_they_were(place: tuple[str, Path]) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "back", artifacts)
    ids = [runs.record(uri, experiment, row(seed), parameters={}) for seed in (0, 1)]
    assert runs.rows(uri, "back") == [
        row(1) | {"run_id": ids[1]},
        row(0) | {"run_id": ids[0]},
    ]


def test_reading_rows_leaves_no_copies(
    place: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "copies", artifacts)
    runs.record(uri, experiment, row() | {"benchmark": "copies"}, parameters={})
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert len(runs.rows(uri, "copies")) == 1
    assert not list(tmp_path.iterdir())


def test_a_row_that_somebody_else_left_leads_nowhere_else(place: tuple[str, Path]) -> None:
    """A registry is shared too: what a row names is linked, read and written by reports."""
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "planted", artifacts)
    evil = row(artifacts={"evaluate": "../../../home"}, benchmark="../evil")
    run_id = runs.record(uri, experiment, evil, parameters={})
    with pytest.raises(InputError) as caught:
        runs.rows(uri, "planted")
    told = str(caught.value)
    assert told.startswith(f"run {run_id}: row.json: `benchmark`: expected letters")
    assert "`artifacts.evaluate`: expected a path below its folder" in told


def test_a_row_recorded_again_updates_its_run(place: tuple[str, Path]) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "again", artifacts)
    failed = row(status="failed", reason="too few views", metrics={}, per_view=[])
    first = runs.record(uri, experiment, failed, parameters={"a": 1})
    assert client(uri).get_run(first).info.status == "FAILED"
    assert client(uri).get_run(first).data.tags["reason"] == "too few views"
    second = runs.record(uri, experiment, row(metrics={"fps": 31.0}), parameters={"a": 1})
    assert second == first
    assert client(uri).get_run(first).info.status == "FINISHED"
    assert client(uri).get_run(first).data.metrics == {"fps": 31.0}
    assert client(uri).get_run(first).data.tags["reason"] == ""


def test_a_run_is_closed_with_what_came_last_and_no_more(place: tuple[str, Path]) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "closed", artifacts)
    run_id = runs.record(uri, experiment, row(), parameters={"a": 1}, final=False)
    recorded = row() | {"run_id": run_id}
    assert client(uri).get_run(run_id).info.status == "RUNNING"
    measured = row(metrics=row()["metrics"] | {"fps": 31.0})
    runs.finish(uri, measured, recorded)
    run = client(uri).get_run(run_id)
    assert (run.info.status, run.data.metrics["fps"]) == ("FINISHED", 31.0)
    assert len(client(uri).get_metric_history(run_id, "psnr")) == 1, "it was logged before"
    assert runs.rows(uri, "closed") == [measured | {"run_id": run_id}]
    runs.finish(uri, row(status="failed", reason="speed was not measured"), recorded)
    run = client(uri).get_run(run_id)
    assert (run.info.status, run.data.tags["reason"]) == ("FAILED", "speed was not measured")


def test_other_code_configuration_or_inputs_are_another_run() -> None:
    keys = {
        run_of_row.row_key(row()),
        run_of_row.row_key(row(1)),
        run_of_row.row_key(row(iterations=200)),
        run_of_row.row_key(row(budget=5000)),
        run_of_row.row_key(row(provenance={"code_version": "new"})),
        run_of_row.row_key(row(provenance=row()["provenance"] | {"inputs": {"photos": "2"}})),
    }
    assert len(keys) == 6
    assert run_of_row.row_key(row(metrics={}, status="failed")) == run_of_row.row_key(row())


def test_an_unknown_benchmark_is_refused_with_the_known_ones(place: tuple[str, Path]) -> None:
    uri, artifacts = place
    runs.open_benchmark(uri, "known", artifacts)
    with pytest.raises(InputError, match=r"'unknown'; known: .*known"):
        runs.rows(uri, "unknown")


# One import of MLflow, which takes seconds, and then as many processes as there are lists of rows
LOG = """
import json, sys
from multiprocessing import get_context
from pathlib import Path
import mlflow.store.tracking.sqlalchemy_store
from tasks.registry import runs

uri, artifacts = sys.argv[1], Path(sys.argv[2])
curve = [{"step": i, "loss": 1 / (i + 1)} for i in range(200)]

def log(rows):
    experiment = runs.open_benchmark(uri, "crowd", artifacts)
    for row in rows:
        runs.record(uri, experiment, row, parameters={"a": 1}, curve=curve)

processes = [get_context("fork").Process(target=log, args=(rows,)) for rows in json.load(sys.stdin)]
for process in processes:
    process.start()
for process in processes:
    process.join()
sys.exit(any(process.exitcode for process in processes))
"""


@pytest.mark.slow
def test_processes_that_log_at_once_lose_nothing(place: tuple[str, Path]) -> None:
    uri, artifacts = place
    lists = [[row(number * ROWS_EACH + k) for k in range(ROWS_EACH)] for number in range(PROCESSES)]
    done = subprocess.run(
        [sys.executable, "-c", LOG, uri, str(artifacts)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        input=json.dumps(lists), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    seeds = sorted(r["seed"] for r in runs.rows(uri, "crowd"))
    assert seeds == list(range(PROCESSES * ROWS_EACH))


def dates(folder: Path) -> dict[str, int]:
    return {str(p.relative_to(folder)): p.stat().st_mtime_ns for p in folder.rglob("*.*")}


def test_a_rerun_uploads_and_logs_nothing_that_is_there(place: tuple[str, Path]) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "rerun", artifacts)
    curve = [{"step": 10, "loss": 0.5}, {"step": 20, "loss": 0.25}]

    def once(whole: dict[str, Any]) -> str:
        """Record as the flow does: first without the speed, then with it."""
        first = whole | {"metrics": {k: v for k, v in whole["metrics"].items() if k != "fps"}}
        run_id = runs.record(
            uri, experiment, first, parameters={"a": 1}, curve=curve, training="t/1", final=False
        )
        runs.finish(uri, whole, first | {"run_id": run_id})
        return run_id

    whole = row() | {"metrics": {"psnr": 24.5, "fps": 50.0}}
    run_id = once(whole)
    folder = artifacts / "rerun" / run_id / "artifacts"
    before = dates(folder)
    assert once(whole) == run_id
    assert dates(folder) == before
    for name in ("psnr", "fps"):
        assert len(client(uri).get_metric_history(run_id, name)) == 1
    assert len(client(uri).get_metric_history(run_id, "curve_loss")) == 2
    assert client(uri).get_run(run_id).info.status == "FINISHED"

    assert once(whole | {"metrics": {"psnr": 24.5, "fps": 55.0}}) == run_id
    assert [m.value for m in client(uri).get_metric_history(run_id, "fps")] == [50.0, 55.0]
    assert len(client(uri).get_metric_history(run_id, "psnr")) == 1
    (stored,) = runs.rows(uri, "rerun")
    assert stored["metrics"]["fps"] == 55.0


def test_each_training_has_a_run_of_its_own(place: tuple[str, Path]) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "trainings", artifacts)
    one = runs.begin(uri, experiment, row(), {}, training="train/a")
    assert runs.begin(uri, experiment, row(), {}, training="train/a") == one
    other = runs.begin(uri, experiment, row(), {}, training="train/b")
    assert other != one
    assert runs.record(uri, experiment, row(), parameters={}, training="train/b") == other
    assert runs.recorded(uri, experiment, row(), "train/b") == row() | {"run_id": other}
    assert runs.recorded(uri, experiment, row(), "train/a") is None


def test_a_replaced_summary_keeps_no_files(place: tuple[str, Path], tmp_path: Path) -> None:
    uri, artifacts = place
    experiment = runs.open_benchmark(uri, "summed", artifacts)
    (tmp_path / "report.html").write_text("page")
    old, new = (
        summary.record_summary(uri, experiment, "summed", [row()], tmp_path) for _ in range(2)
    )
    files = {run: artifacts / "summed" / run / "artifacts" for run in (old, new)}
    assert summary.purge(uri, dry_run=True) == [old]
    assert (files[old] / "report" / "report.html").is_file()
    assert summary.purge(uri) == [old]
    assert not (files[old] / "report").exists()
    assert (files[new] / "report" / "report.html").is_file()
    assert summary.purge(uri) == []
