"""Our own services while they start: what an interruption waits for, and what it leaves."""

import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from threading import Event, Timer
from types import SimpleNamespace

import pytest

from flows.services import dask_cluster, embedded, prefect_settings
from mattgs_ops.config import RunConfig
from mattgs_ops.errors import InputError, StageError
from tasks.registry import runs


class Slow:
    """Services that are up when they are let."""

    def __init__(self) -> None:
        self.let = Event()
        self.up: list[str] = []

    def initialise(self, _: str) -> None:
        self.let.wait(60)
        self.up.append("mlflow")

    @contextmanager
    def started(self, _: Path, __: RunConfig) -> Iterator[None]:
        self.let.wait(60)
        self.up.append("dask")
        yield


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[Slow]:
    """Replace MLflow and Dask; Prefect is named and answers."""
    slow = Slow()
    monkeypatch.setattr(prefect_settings, "api_url", lambda: "http://127.0.0.1:4200/api")
    monkeypatch.setattr(prefect_settings, "check", lambda _: None)
    monkeypatch.setattr(runs, "initialise", slow.initialise)
    monkeypatch.setattr(dask_cluster, "started", slow.started)
    yield slow
    slow.let.set()


@pytest.mark.parametrize(
    ("left_by", "told"),
    [
        (KeyboardInterrupt(), "mattgs: interrupted; ending its services\n"),
        (InputError("no such photo"), ""),
    ],
)
def test_ctrl_c_and_bad_input_do_not_wait_for_what_is_still_starting(
    slow: Slow,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    left_by: BaseException,
    told: str,
) -> None:
    starting = embedded.Starting(tmp_path, RunConfig(), 1)
    with pytest.raises(type(left_by)), starting:
        raise left_by
    assert slow.up == []
    assert capsys.readouterr().err == told
    assert "PREFECT_API_URL" not in os.environ, "all else has ended"
    slow.let.set()
    for thread in (starting._mlflow, starting._workers):
        thread.join()


def test_after_another_error_nothing_goes_on_starting(
    slow: Slow, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Timer(0.2, slow.let.set).start()
    with pytest.raises(StageError), embedded.Starting(tmp_path, RunConfig(), 1):
        raise StageError("no process could be started")
    assert sorted(slow.up) == ["dask", "mlflow"]
    assert capsys.readouterr().err == ""


def test_no_garbage_is_collected_until_all_is_ready_or_given_up(
    slow: Slow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prefect_settings, "using", lambda _: nullcontext())
    cluster = SimpleNamespace(scheduler=None, dashboard="")
    monkeypatch.setattr(dask_cluster, "started", lambda _, __: nullcontext(cluster))
    slow.let.set()
    with embedded.Starting(tmp_path, RunConfig(), 1) as starting:
        assert not gc.isenabled()
        starting.ready()
        assert gc.isenabled()
    with pytest.raises(InputError), embedded.Starting(tmp_path, RunConfig(), 1):
        raise InputError("no such photo")
    assert gc.isenabled()


class OwnServer:
    """An address and a home, as of a server of our own that nobody asks anything."""

    def __init__(self, home: Path) -> None:
        self.home = home

    def address(self) -> str:
        return "http://127.0.0.1:1/api"


def test_workers_are_told_of_one_authority_for_our_own_server_and_of_none_for_a_named_one(
    slow: Slow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow.let.set()
    key = "PREFECT_API_SSL_CERT_FILE"
    with embedded.Starting(tmp_path, RunConfig(), 1):
        assert key not in os.environ, "a server that was named may have an authority of its own"

    @contextmanager
    def own(_: Path) -> Iterator[OwnServer]:
        yield OwnServer(tmp_path)

    monkeypatch.setattr(prefect_settings, "api_url", lambda: None)
    monkeypatch.setattr(embedded, "_prefect_server", own)
    with embedded.Starting(tmp_path, RunConfig(), 1):
        assert Path(os.environ[key]).read_text(encoding="utf-8").count("BEGIN CERTIFICATE") == 1
    assert key not in os.environ


LEFT = """
import os, sys
from pathlib import Path
from flows.services import embedded
embedded.enter(Path(sys.argv[1]))
from multiprocessing import get_context, resource_tracker
lock = get_context("spawn").Lock()
os._exit(0)
"""


def test_semaphores_of_a_process_that_ended_at_once_are_removed_without_a_word(
    tmp_path: Path,
) -> None:
    environment = {name: at for name, at in os.environ.items() if name != "PYTHONWARNINGS"}
    command = [sys.executable, "-c", LEFT, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stderr == ""
