"""``mattgs ui`` serves the runs of a folder, and leaves no server behind."""

import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest

from flows.cli import app
from flows.services import mlflow_ui, registries
from mattgs_ops.errors import InputError
from tasks.registry import runs

pytestmark = pytest.mark.slow

TIMEOUT = 240


def answers(port: int) -> bool:
    try:
        with urlopen(f"http://127.0.0.1:{port}/health", timeout=5):
            return True
    except (URLError, ConnectionError, TimeoutError):
        return False


def until(wanted: bool, port: int) -> None:
    end = time.monotonic() + TIMEOUT
    while answers(port) is not wanted:
        assert time.monotonic() < end, f"the server's answer did not become {wanted}"
        time.sleep(0.2)


def test_pages_are_named_and_sigterm_ends_the_server_too(tmp_path: Path) -> None:
    runs.initialise(registries.current(tmp_path))
    toy = runs.open_benchmark(registries.current(tmp_path), "toy", None)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "flows.cli.app", "ui", "--out", str(tmp_path)]
    command += ["--port", str(port), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as shown:
        until(True, port)
        shown.send_signal(signal.SIGTERM)
        assert shown.wait(TIMEOUT) == app.EXIT_TERMINATED
        assert shown.stdout is not None
        printed = shown.stdout.read().decode()
    assert f"  toy: http://127.0.0.1:{port}/#/experiments/{toy}/runs?" in printed
    until(False, port)


def test_a_folder_without_runs_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"{tmp_path}: no runs were recorded there"):
        mlflow_ui.show(tmp_path, 0, browser=False)
