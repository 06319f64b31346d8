"""Runs of processes that died are closed; those of living ones, and of other machines, are not."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tasks.registry import runs, summary
from tasks.registry.content import owner
from tasks.registry.run_of_row import OWNER_TAG
from tasks.registry.segmenter_training import TrainingRun
from tasks.registry.upkeep.orphans import close_orphans

OPEN = """
import json, sys
from pathlib import Path
from tasks.registry import runs
uri, row = sys.argv[1], json.loads(sys.argv[2])
experiment = runs.open_benchmark(uri, "small", Path(sys.argv[3]))
runs.begin(uri, experiment, row, {})
print(runs.record(uri, experiment, row | {"seed": 1}, parameters={}, final=False))
"""


def row(seed: int = 0) -> dict[str, Any]:
    return {
        "benchmark": "small", "capture": "ball", "condition": "nobg-ours", "background": "nobg",
        "method": "ours", "seed": seed, "iterations": 10, "resolution": 32, "status": "finished",
        "reason": None, "metrics": {}, "per_view": [], "provenance": {"config_digest": "c"},
    }  # fmt: skip


@pytest.fixture
def uri(tmp_path: Path, fresh_registry: Path) -> str:
    shutil.copy(fresh_registry, tmp_path / "mlflow.db")
    return f"sqlite:///{tmp_path / 'mlflow.db'}"


def statuses(uri: str, benchmark: str) -> dict[str, str]:
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=uri)
    experiment = client.get_experiment_by_name(benchmark).experiment_id
    return {run.info.run_name: run.info.status for run in client.search_runs([experiment])}


def test_what_a_dead_process_left_open_is_closed_and_nothing_else(uri: str, tmp_path: Path) -> None:
    import json

    command = [sys.executable, "-c", OPEN, uri, json.dumps(row()), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    experiment = runs.open_benchmark(uri, "small", tmp_path)
    runs.begin(uri, experiment, row(2), {})  # this process lives
    TrainingRun(uri, tmp_path, "k", {})

    would = close_orphans(uri, dry_run=True)
    assert set(statuses(uri, "small").values()) == {"RUNNING"}
    assert close_orphans(uri, "small") == would
    assert statuses(uri, "small") == {
        "ball nobg-ours seed 0": "KILLED",
        "ball nobg-ours seed 1": "KILLED",
        "ball nobg-ours seed 2": "RUNNING",
    }
    assert list(statuses(uri, "segmenter").values()) == ["RUNNING"]
    assert close_orphans(uri) == []
    assert [r["seed"] for r in runs.rows(uri, "small")] == [1], "what it had is still there"


def test_the_same_experiment_goes_on_in_the_run_that_was_closed(uri: str, tmp_path: Path) -> None:
    experiment = runs.open_benchmark(uri, "small", tmp_path)
    first = runs.begin(uri, experiment, row(), {})
    _disown(uri, first)
    assert len(close_orphans(uri)) == 1
    assert runs.begin(uri, experiment, row(), {}) == first
    assert statuses(uri, "small") == {"ball nobg-ours seed 0": "RUNNING"}
    assert close_orphans(uri) == []
    runs.record(uri, experiment, row(), parameters={})
    assert statuses(uri, "small") == {"ball nobg-ours seed 0": "FINISHED"}


def test_an_interrupted_run_hides_no_older_one_that_finished(uri: str, tmp_path: Path) -> None:
    experiment = runs.open_benchmark(uri, "small", tmp_path)
    whole = runs.record(uri, experiment, row() | {"metrics": {"fps": 30.0}}, parameters={})
    newer = row() | {"provenance": {"config_digest": "c", "code_version": "2"}}
    _disown(uri, runs.record(uri, experiment, newer, parameters={}, final=False))
    close_orphans(uri, "small")
    (reported,) = summary.report_rows(uri, "small")
    assert reported["run_id"] == whole


@pytest.mark.parametrize("text", ["", "elsewhere 1 1", "bench", "bench x y"])
def test_only_processes_of_this_machine_can_be_known_to_be_dead(text: str) -> None:
    assert not owner.is_dead(text)


def test_a_number_that_was_given_out_again_is_another_process() -> None:
    machine, number, began = owner.owner().rsplit(" ", 2)
    assert not owner.is_dead(f"{machine} {number} {began}")
    assert owner.is_dead(f"{machine} {number} {int(began) - 3600}")


def _disown(uri: str, run_id: str) -> None:
    """Make a run belong to a process that has ended."""
    from mlflow.tracking import MlflowClient

    machine, number, began = owner.owner().rsplit(" ", 2)
    dead = f"{machine} {number} {int(began) - 3600}"
    MlflowClient(tracking_uri=uri).set_tag(run_id, OWNER_TAG, dead)
