"""The temporary Prefect server: answers, dies with its owner, and starts from a kept database."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import psutil
import pytest

from flows.services.prefect_server import PrefectServer, healthy

OWNER = """
import sys, time
from pathlib import Path
from flows.services.prefect_server import PrefectServer
server = PrefectServer(Path(sys.argv[1]), Path(sys.argv[1]) / "log")
server.wait()
print(server.address(), flush=True)
time.sleep(600)
"""


FOLLOWER = """
import sys, time
from pathlib import Path
from flows.services.prefect_server import PrefectServer
server = PrefectServer(Path(sys.argv[1]), Path(sys.argv[1]) / "log")
server.follow(3)
print("follows", flush=True)
time.sleep(600)
"""


def test_a_flow_does_not_outlive_its_server(tmp_path: Path) -> None:
    command = [sys.executable, "-c", FOLLOWER, str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment) as flow:
        assert flow.stdout is not None
        assert flow.stdout.readline() == "follows\n"
        (server,) = psutil.Process(flow.pid).children()
        server.kill()
        _, told = flow.communicate(timeout=60)
    assert flow.returncode == 3
    assert told.startswith("mattgs: the Prefect server ended; the same command goes on")


def runs(database: Path) -> int:
    with closing(sqlite3.connect(database)) as connection:
        return int(connection.execute("SELECT count(*) FROM flow_run").fetchone()[0])


@pytest.mark.slow
def test_a_server_serves_and_dies_with_its_owner_and_the_next_starts_from_its_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "queue.py").write_text("raise SystemExit('a script of the user')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    command = [sys.executable, "-P", "-c", OWNER, str(tmp_path / "one")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as owner:
        assert owner.stdout is not None
        url = owner.stdout.readline().strip()
        assert healthy(url)
        (server,) = psutil.Process(owner.pid).children()
        owner.send_signal(signal.SIGKILL)
    server.wait(timeout=60)
    end = time.monotonic() + 60
    while healthy(url):
        assert time.monotonic() < end
    (kept,) = (tmp_path / "cache" / "mattgs").iterdir()
    assert runs(kept) == 0

    second = PrefectServer(tmp_path / "two", tmp_path / "two" / "log")
    try:
        assert runs(tmp_path / "two" / "prefect.db") == 0, "has its tables before it answers"
        second.wait()
        assert healthy(second.address())
    finally:
        second.stop()
