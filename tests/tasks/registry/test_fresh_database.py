"""A fresh database of MLflow: whole or not there, whoever is killed; a copy of an empty one."""

import fcntl
import os
import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from tasks.registry import runs
from tests.tasks.waiting import wait_for


def client(uri: str) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=uri)


# One import of MLflow, which takes seconds; then a process that is killed, and two that are not
MANY = """
import sys
from multiprocessing import get_context
import mlflow.store.tracking.sqlalchemy_store
from tasks.registry import runs

def began():
    process = get_context("fork").Process(target=runs.initialise, args=sys.argv[1:])
    process.start()
    return process

first = began()
print(first.pid, flush=True)
first.join()
print("gone", flush=True)
sys.stdin.readline()
others = [began() for _ in range(2)]
for one in others:
    one.join()
sys.exit(any(one.exitcode for one in others))
"""


def test_a_database_is_whole_or_not_there_and_a_broken_one_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many begin at once; one is killed while it makes the tables."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))  # where none is kept yet
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", MANY, uri]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as many:
        assert many.stdout is not None
        first = int(many.stdout.readline())
        wait_for(lambda: list(tmp_path.glob("mlflow.db.*.part")))
        os.kill(first, signal.SIGKILL)
        assert many.stdout.readline() == "gone\n"
        assert not (tmp_path / "mlflow.db").exists()
        many.communicate("go on\n")
    assert many.returncode == 0
    assert client(uri).search_experiments()
    (tmp_path / "broken.db").write_bytes(b"no database" * 100)
    with pytest.raises(InputError, match="cannot be used"):
        runs.initialise(f"sqlite:///{tmp_path / 'broken.db'}")


def test_a_database_begins_as_a_copy_of_an_empty_one_and_names_its_own_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for name in ("one", "two"):  # MLflow makes the first
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        uri = f"sqlite:///{tmp_path / name / 'mlflow.db'}"
        runs.initialise(uri)
        (default,) = client(uri).search_experiments()
        assert (default.experiment_id, default.name) == ("0", "Default")
        assert default.artifact_location == str(tmp_path / name / "mlruns" / "0")
        experiment = runs.open_benchmark(uri, "first", tmp_path / name)
        assert experiment == "1"
    (kept,) = (tmp_path / "cache" / "mattgs").iterdir()
    with closing(sqlite3.connect(kept)) as database:
        assert database.execute("SELECT count(*) FROM experiments").fetchone() == (0,)


def test_a_database_that_was_broken_off_is_removed_unless_somebody_makes_it(tmp_path: Path) -> None:
    left = [tmp_path / f"mlflow.db.4711.part{tail}" for tail in ("", "-journal")]
    for path in left:
        path.touch()
    with (tmp_path / "mlflow.db.lock").open("w") as lock, ThreadPoolExecutor(1) as other:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = other.submit(runs.initialise, f"sqlite:///{tmp_path / 'mlflow.db'}")
        with pytest.raises(TimeoutError):
            made.result(0.5)
        assert all(path.exists() for path in left)
        fcntl.flock(lock, fcntl.LOCK_UN)
        made.result()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mlflow.db", "mlflow.db.lock"]
