"""Stages in processes of their own: whatever happens in there is an ordinary failure here."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError, StageError
from tasks.stages.process import CrashError, StageJob, run
from tasks.stages.status import StatusFile, read
from tests.tasks.waiting import alive, wait_for

OPERATIONS = """
import ctypes, os, signal, subprocess, time
from pathlib import Path
from mattgs_ops.errors import InputError, StageError

def good(arguments, out, threads, progress):
    print("a library talks")
    for i in range(3):
        progress(i + 1, 3, f"step {i + 1}")
    (out / "threads").write_text(f"{threads} {os.environ['OMP_NUM_THREADS']} {arguments['x']}")

def memory(arguments, out, threads, progress):
    (out / "trim").write_text(os.environ.get("MALLOC_TRIM_THRESHOLD_", "its own"))

def spared(arguments, out, threads, progress):
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())

def segfault(arguments, out, threads, progress):
    ctypes.string_at(0)

def killed(arguments, out, threads, progress):
    os.kill(os.getpid(), 9)

def input_error(arguments, out, threads, progress):
    raise InputError("photo.jpg: expected a photo")

def bug(arguments, out, threads, progress):
    raise KeyError("missing")

def cannot_say(arguments, out, threads, progress):
    print("the disk is full")
    (out / "logs" / "try.verdict.json").touch()
    os._exit(1)

def leaves(arguments, out, threads, progress):
    print("no licence for this")
    os._exit(7)

def endless(arguments, out, threads, progress):
    (out / "pid").write_text(str(os.getpid()))
    time.sleep(600)

def leaves_a_service(arguments, out, threads, progress):
    command = "trap '' TERM; echo $$ > pid; sleep 600 & wait; wait"
    subprocess.Popen(["sh", "-c", command], cwd=out, stdin=subprocess.DEVNULL)
    while not (out / "pid").is_file() or not (out / "pid").read_text():
        time.sleep(0.01)
    time.sleep(600 * arguments["stays"])
"""


@pytest.fixture(params=[(), ("statistics",)], ids=["fresh", "forked"])
def job(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that makes jobs, for a process of its own and for a launcher's."""
    (tmp_path / "operations_here.py").write_text(OPERATIONS)
    monkeypatch.syspath_prepend(tmp_path)

    def make(name: str, timeout: float = 60, **arguments: Any) -> StageJob:
        return StageJob(
            title=f"try {name}",
            operation=f"operations_here:{name}",
            arguments=arguments,
            out=tmp_path,
            log=tmp_path / "logs" / "try.log",
            status=tmp_path / "status" / "try.json",
            threads=2,
            timeout=timeout,
            imports=request.param,
        )

    return make


def test_a_stage_gets_its_arguments_and_threads_and_its_output_goes_to_the_log(
    job: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    work = job("good", x="ü")
    StatusFile(work.status).begin("try good", "try")
    run(work)
    assert (tmp_path / "threads").read_text() == "2 2 ü"
    assert "a library talks" in work.log.read_text()
    assert capfd.readouterr() == ("", "")
    status = read(work.status)
    assert status is not None
    assert (status.done, status.total, status.note) == (3, 3, "step 3")


def test_files_of_the_current_folder_are_not_taken_for_modules(
    job: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A script of the user's called as one of Python's own modules, or as ours."""
    folder = tmp_path / "scripts"
    folder.mkdir()
    for name in ("dataclasses", "json", "queue", "subprocess", "tasks"):
        (folder / f"{name}.py").write_text("raise SystemExit('a script of the user')")
    monkeypatch.chdir(folder)
    with ThreadPoolExecutor(1) as thread:  # a launcher of its own, started in this folder
        thread.submit(run, job("good", x=1)).result()
    assert (tmp_path / "threads").read_text() == "2 2 1"


def test_a_stage_does_not_inherit_how_dask_has_its_workers_give_memory_back(
    job: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    run(job("memory"))
    assert (tmp_path / "trim").read_text() == "its own"


def test_a_stage_may_be_interrupted_though_its_worker_may_not(job: Any) -> None:
    """Programs that it starts may send each other SIGINT."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        run(job("spared"))
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@pytest.mark.parametrize(
    ("name", "error", "says"),
    [
        ("segfault", CrashError, "SIGSEGV"),
        ("killed", CrashError, "out of memory"),
        ("bug", StageError, "KeyError: 'missing'"),
        ("leaves", StageError, "status 7: .*no licence for this"),
        ("cannot_say", StageError, "status 1: .*the disk is full; log: "),
        ("input_error", InputError, "^photo.jpg: expected a photo$"),
    ],
)
def test_whatever_ends_a_stage_is_an_error_with_its_reason(
    job: Any, name: str, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        run(job(name))


def test_a_failure_is_not_taken_for_the_next_attempts(job: Any) -> None:
    with pytest.raises(InputError):
        run(job("input_error"))
    run(job("good", x=1))


def end_by_limit(job: Any, pid: Path, name: str, **arguments: Any) -> None:
    """Have a stage take too long; again with more time where it had not told its pid by then."""
    for limit in (1, 5, 25):
        with pytest.raises(StageError, match=f"longer than {limit} s"):
            run(job(name, timeout=limit, **arguments))
        if pid.is_file() and pid.read_text():
            return
    pytest.fail("the stage never came to its work")


def test_a_stage_that_takes_too_long_is_ended(job: Any, tmp_path: Path) -> None:
    end_by_limit(job, tmp_path / "pid", "endless")
    assert not alive(int((tmp_path / "pid").read_text()))


@pytest.mark.parametrize("stays", [True, False])
def test_nothing_that_a_stage_started_outlives_it(job: Any, tmp_path: Path, stays: bool) -> None:
    """A trainer's script starts the trainer, which may not listen to SIGTERM."""
    if stays:
        end_by_limit(job, tmp_path / "pid", "leaves_a_service", stays=True)
    else:
        run(job("leaves_a_service", stays=False))
    wait_for(lambda: not alive(int((tmp_path / "pid").read_text())))


def test_a_stage_dies_with_the_process_that_started_it(job: Any, tmp_path: Path) -> None:
    work = job("endless")
    work.save(tmp_path / "job.json")
    code = (
        "import sys; from pathlib import Path; from tasks.stages.process import StageJob, run; "
        f"run(StageJob.load(Path({str(tmp_path / 'job.json')!r})))"
    )
    env = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    parent = subprocess.Popen([sys.executable, "-c", code], env=env)
    pid_file = tmp_path / "pid"
    wait_for(lambda: pid_file.is_file() and pid_file.read_text() != "")
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    wait_for(lambda: not alive(int(pid_file.read_text())))
