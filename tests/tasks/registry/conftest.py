"""A real MLflow server on loopback, with SQLite behind it, that keeps the files itself."""

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

STARTING = 240  # seconds that a busy machine may take for the server


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory, fresh_registry: Path) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("server")
    shutil.copy(fresh_registry, folder / "mlflow.db")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "mlflow", "server", "--workers", "1", "--host", "127.0.0.1"]
    command += ["--port", str(port), "--backend-store-uri", f"sqlite:///{folder / 'mlflow.db'}"]
    command += ["--serve-artifacts", "--artifacts-destination", str(folder / "files")]
    environment = os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    address = f"http://127.0.0.1:{port}"
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            command, env=environment, stdout=log, stderr=log, start_new_session=True
        )
        try:
            _wait_for(address, process)
            yield address
        finally:
            os.killpg(process.pid, 15)
            process.wait(timeout=STARTING)


def _wait_for(address: str, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + STARTING
    while True:
        assert process.poll() is None, "the server ended"
        assert time.monotonic() < end, "the server did not answer"
        try:
            urllib.request.urlopen(f"{address}/health", timeout=5).close()
        except (urllib.error.URLError, TimeoutError):
            time.sleep(0.2)
        else:
            return
