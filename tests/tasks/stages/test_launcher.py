"""Forked stages: as isolated as fresh processes, and never with code that is no longer there."""

import os
import select
import signal
import threading
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import StageError
from tasks.stages import launcher
from tasks.stages.process import CrashError, StageJob, run
from tasks.stages.source_times import source_times
from tests.tasks.waiting import alive, wait_for

OPERATIONS = """
import os, sys, threading, time

def look(arguments, out, threads, progress):
    import cv2
    shared = "colorsys" in sys.modules
    seen = [os.getpid(), os.getppid(), os.getsid(0), cv2.getNumThreads(), shared]
    (out / "seen").write_text(" ".join(str(int(value)) for value in seen))

def stains(arguments, out, threads, progress):
    import colorsys
    os.environ["STAINED"] = "yes"

def needs_broken(arguments, out, threads, progress):
    import broken_module

def endless(arguments, out, threads, progress):
    (out / "pid").write_text(f"{os.getpid()} {os.getppid()}")
    time.sleep(600)
"""


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    (tmp_path / "forked_here.py").write_text(OPERATIONS)
    (tmp_path / "starts_a_thread.py").write_text(
        "import threading\nthreading.Thread(target=threading.Event().wait, daemon=True).start()\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def make(name: str, *imports: str, threads: int = 1) -> StageJob:
        return StageJob(
            title=f"try {name}",
            operation=f"forked_here:{name}",
            arguments={},
            out=tmp_path,
            log=tmp_path / "logs" / f"{name}.log",
            status=tmp_path / "status" / "try.json",
            threads=threads,
            timeout=60,
            imports=imports or ("cv2",),
        )

    return make


def seen(folder: Path) -> list[int]:
    return [int(word) for word in (folder / "seen").read_text().split()]


def test_stages_of_one_launcher_share_imports_and_nothing_else(job: Any, tmp_path: Path) -> None:
    run(job("stains"))
    run(job("look", threads=2))
    first = seen(tmp_path)
    run(job("look"))
    second = seen(tmp_path)
    process, parent, session, cv2_threads, stained = first
    assert (session, stained, cv2_threads) == (process, 0, 2)
    assert second[3] == 1, "threads are a stage's own"
    assert (second[1], second[0] != process) == (parent, True)
    assert parent != os.getpid()
    assert "STAINED" not in os.environ


def test_touched_sources_are_imported_anew(
    job: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(job("look"))
    before = seen(tmp_path)[1]
    times = source_times()
    monkeypatch.setattr(launcher, "source_times", lambda: (*times[1:], (times[0][0], 1)))
    run(job("look"))
    assert seen(tmp_path)[1] != before
    assert not alive(before)


def test_a_launcher_that_is_killed_takes_its_stage_along_and_is_replaced(
    job: Any, tmp_path: Path
) -> None:
    failures: list[Exception] = []

    def work() -> None:
        try:
            run(job("endless"))
        except CrashError as error:
            failures.append(error)
        run(job("look"))

    thread = threading.Thread(target=work)
    thread.start()
    told = tmp_path / "pid"
    wait_for(lambda: told.is_file() and len(told.read_text().split()) > 1)
    stage, parent = map(int, (tmp_path / "pid").read_text().split())
    os.kill(parent, signal.SIGKILL)
    thread.join(60)
    (failure,) = failures
    assert "SIGKILL" in str(failure)
    wait_for(lambda: not alive(stage))
    assert seen(tmp_path)[1] != parent


def test_a_module_that_starts_threads_cannot_be_forked_with(job: Any) -> None:
    with pytest.raises(StageError, match="starts_a_thread started threads when it was imported"):
        run(job("look", "starts_a_thread"))
    run(job("look"))


def test_what_cannot_be_imported_is_told_by_the_stage_itself(job: Any, tmp_path: Path) -> None:
    (tmp_path / "broken_module.py").write_text("raise RuntimeError('no such device')\n")
    run(job("look", "broken_module"))  # which does not need it
    with pytest.raises(StageError, match="RuntimeError: no such device"):
        run(job("needs_broken", "broken_module"))


def test_a_stage_that_ended_before_its_start_was_read_is_still_heard_of() -> None:
    reading, writing = os.pipe()
    os.write(writing, b'{"process": 1}\n{"code": 3}\n')
    with os.fdopen(reading, "rb") as stream, os.fdopen(writing, "wb"):
        answers = launcher._answers(stream)
        assert answers.readline() == b'{"process": 1}\n'
        assert select.select([answers], [], [], 0)[0], "the second answer is in no buffer"
        assert answers.readline() == b'{"code": 3}\n'
