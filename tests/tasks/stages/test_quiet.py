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


def attempt(folder: Path) -> subprocess.CompletedProcess[str]:
    """Let a process work that has this temporary folder; returns how that ended."""
    path = os.pathsep.join(p for p in sys.path if p)
    environment = os.environ | {"PYTHONPATH": path, "TMPDIR": str(folder)}
    command = [sys.executable, "-c", HOLD, "busy"]
    return subprocess.run(
        command,
        input="\n",
        capture_output=True,
        text=True,
        env=environment,
        timeout=120,
        check=False,
    )


def locks(folder: Path) -> Path:
    """Return where the locks lie; anybody can know that."""
    return folder / f"mattgs-{os.getuid()}"


def test_a_planted_link_to_a_folder_is_not_followed(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.mkdir(mode=0o700)
    locks(tmp_path).symlink_to(theirs)
    done = attempt(tmp_path)
    assert done.returncode != 0
    assert f"InputError: {locks(tmp_path)}: expected a folder of user" in done.stderr
    assert "found a link; remove it, or set TMPDIR" in done.stderr
    assert not list(theirs.iterdir())


def test_a_planted_link_to_a_file_is_not_followed_and_nothing_is_emptied(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    locks(tmp_path).mkdir(mode=0o700)
    (locks(tmp_path) / "gate").symlink_to(precious)
    done = attempt(tmp_path)
    assert done.returncode != 0
    assert f"{locks(tmp_path) / 'gate'}: expected a file to lock" in done.stderr
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o701])
def test_a_folder_that_others_can_enter_is_refused(tmp_path: Path, mode: int) -> None:
    locks(tmp_path).mkdir()
    locks(tmp_path).chmod(mode)
    done = attempt(tmp_path)
    assert done.returncode != 0
    assert f"found one of user {os.getuid()} with mode {mode:o}" in done.stderr


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder to another user")
def test_another_users_folder_is_refused(tmp_path: Path) -> None:
    locks(tmp_path).mkdir(mode=0o700)
    os.chown(locks(tmp_path), 12345, -1)
    done = attempt(tmp_path)
    assert done.returncode != 0
    assert "found one of user 12345 with mode 700" in done.stderr
