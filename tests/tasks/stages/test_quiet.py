"""Measuring waits for what runs on the machine, and what would follow waits for the measuring."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

HOLD = """
import sys
from tasks.stages import quiet
print("starts", flush=True)
with getattr(quiet, sys.argv[1])():
    print("in", flush=True)
    sys.stdin.readline()
print("out", flush=True)
"""
Process = subprocess.Popen[str]
SHORT = 0.3  # seconds in which somebody who need not wait would long have gone in


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str], Process]]:
    """Return what starts a process that works or measures until it is told to end."""
    started: list[Process] = []
    path = os.pathsep.join(p for p in sys.path if p)
    environment = os.environ | {"PYTHONPATH": path, "TMPDIR": str(tmp_path)}

    def begin(how: str) -> Process:
        command = [sys.executable, "-c", HOLD, how]
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
        started.append(process)
        assert line(process) == "starts"
        return process

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def line(process: Process) -> str:
    """Return the next line that a process prints, waiting for it."""
    assert process.stdout is not None
    return process.stdout.readline().strip()


def end(process: Process) -> None:
    process.communicate("\n", timeout=60)


def waits(process: Process) -> bool:
    """Whether a process has not gone in and does not do so either."""
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], SHORT)
    return not ready


def test_speed_is_measured_when_nothing_else_runs_and_nothing_starts_meanwhile(
    start: Callable[[str], Process],
) -> None:
    works = [start("busy"), start("busy")]
    assert [line(one) for one in works] == ["in", "in"], "stages do not wait for one another"
    measures = start("alone")
    assert waits(measures)
    late = start("busy")
    assert waits(late), "would delay the measuring for ever"
    end(works[0])
    assert waits(measures), "one stage still runs"
    end(works[1])
    assert line(measures) == "in"
    assert waits(late)
    end(measures)
    assert line(late) == "in"


def test_a_killed_owner_keeps_nobody_waiting(start: Callable[[str], Process]) -> None:
    measures = start("alone")
    assert line(measures) == "in"
    late = start("busy")
    assert waits(late)
    measures.send_signal(signal.SIGKILL)
    assert line(late) == "in"
