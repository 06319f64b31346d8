"""Runs one operation in a process of its own, so that whatever it does stays an ordinary failure.

A segmentation fault, an out-of-memory kill or an endless loop inside native code ends the process,
not the worker: the parent gets a :class:`StageError` that says what happened and where the log is.

The parent calls :func:`run`. The child is ``python -m tasks.stages.process JOB.json``, which can be
typed by hand to repeat a stage exactly, or a fork of a process that has imported what the stage
needs (``launcher.py``). The named operation is ``MODULE:FUNCTION`` and is called as
``function(arguments, out, threads, progress)``. Its standard output and errors go to the log; what
it reports through ``progress`` goes, throttled, to the job's status file
(see ``tasks/stages/status.py``).

The child dies with its parent thread (Linux ``PR_SET_PDEATHSIG``): no training outlives a killed
worker.
"""

import faulthandler
import importlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from mattgs_ops.child_process import die_with_parent, how_it_ended
from mattgs_ops.errors import InputError, MattgsError, StageError
from mattgs_ops.progress import Progress
from mattgs_ops.whole_file import written_whole
from tasks.stages import launcher
from tasks.stages.status import StatusFile

Operation = Callable[[dict[str, Any], Path, int, Progress], None]
Child = subprocess.Popen[bytes] | launcher.Launched

GRACE_SECONDS = 5.0  # between asking a late stage to end and killing it
HEADER = "---"  # begins the line before an attempt's lines in the log
LOG_TAIL_LINES = 3  # quoted when a process dies without saying why
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)
# Dask sets it for its workers: memory goes back to the system at once, and each array that a stage
# makes is mapped, cleared and unmapped anew, which may take longer than what is done with it
NOT_INHERITED = "MALLOC_TRIM_THRESHOLD_"


class CrashError(StageError):
    """The process ended without saying why: killed, crashed. Another try may succeed."""


@dataclass(frozen=True)
class StageJob:
    """What to run and where.

    ``operation`` is ``MODULE:FUNCTION``; ``arguments`` are JSON values; ``out`` is the work folder
    that the operation fills; ``log`` is appended to; ``timeout`` is in seconds; ``status`` names
    the file that tells progress. ``imports`` are modules that the operation will need and that
    start no threads: with some, the process is forked from one that has them (``launcher.py``).
    ``key`` is the stage's place in the store; ``began`` in seconds since the epoch.
    """

    title: str
    operation: str
    arguments: dict[str, Any]
    out: Path
    log: Path
    status: Path
    threads: int
    timeout: float
    imports: tuple[str, ...] = ()
    key: str = ""
    began: float = 0.0

    def save(self, path: Path) -> None:
        """Write the job as JSON."""
        path.write_text(json.dumps(asdict(self), indent=1, default=str) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> "StageJob":
        """Read a job written by :meth:`save`."""
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        paths = {key: Path(data[key]) for key in ("out", "log", "status")}
        return cls(**data | paths | {"imports": tuple(data.get("imports", ()))})


def run(job: StageJob) -> None:
    """Run the job to its end in a child process.

    Raises the child's :class:`InputError` or :class:`StageError` as it was, and a
    :class:`StageError` when the child crashed, was killed or took longer than ``job.timeout``.
    """
    job.log.parent.mkdir(parents=True, exist_ok=True)
    job_file = job.log.with_suffix(".job.json")
    verdict = job.log.with_suffix(".verdict.json")
    verdict.unlink(missing_ok=True)
    job.save(job_file)
    with job.log.open("ab") as log:
        log.write(f"{HEADER} {time.strftime('%Y-%m-%d %H:%M:%S')} {job.title}\n".encode())
        log.flush()
        child = _start(job, job_file, log)
        if isinstance(child, int):
            code = child
        else:
            try:
                code = child.wait(timeout=job.timeout)
            except subprocess.TimeoutExpired as error:
                raise StageError(
                    f"{job.title}: took longer than {job.timeout:g} s and was ended; log: {job.log}"
                ) from error
            finally:
                _end(child)
    _raise_for(code, verdict, job)
    job_file.unlink(missing_ok=True)


def _start(job: StageJob, job_file: Path, log: IO[bytes]) -> Child | int:
    """Start the job's process: forked where its imports allow that, else a fresh one."""
    if job.imports:
        request = {
            "job": str(job_file),
            "imports": job.imports,
            "threads": job.threads,
            "environment": _environment(job.threads),
            "path": sys.path,
            "folder": str(Path.cwd()),
            "log": str(job.log),
        }
        return launcher.launch(request, _environment(threads=1), log)
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "tasks.stages.process", str(job_file), str(os.getpid())],
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=subprocess.STDOUT,
        env=_environment(job.threads),
        start_new_session=True,  # its own process group: killed whole, spared Ctrl-C
    )


def _end(child: Child) -> None:
    """End the child's process group, politely first; what outlives the child in it is killed."""
    for signal_number, patience in ((signal.SIGTERM, GRACE_SECONDS), (signal.SIGKILL, None)):
        if child.poll() is not None:
            break
        with suppress(ProcessLookupError):  # it ended just now
            os.killpg(child.pid, signal_number)
        try:
            child.wait(timeout=patience)
        except subprocess.TimeoutExpired:
            continue
    with suppress(ProcessLookupError, PermissionError):  # nobody is left
        os.killpg(child.pid, signal.SIGKILL)


def _environment(threads: int) -> dict[str, str]:
    """Environment of the child: stated thread counts, unbuffered output, importable code."""
    paths = [path for path in sys.path if path]
    return {
        **{name: value for name, value in os.environ.items() if name != NOT_INHERITED},
        **dict.fromkeys(THREAD_VARIABLES, str(threads)),
        "OMP_WAIT_POLICY": "PASSIVE",  # spinning barriers starve the neighbours on a shared machine
        "MPLBACKEND": "Agg",
        "PYTHONUNBUFFERED": "1",
        "PYTHONPATH": os.pathsep.join(paths),
    }


def _raise_for(code: int, verdict: Path, job: StageJob) -> None:
    """Turn a bad end into an exception; return when all went well."""
    failure = _verdict(verdict)
    if failure is not None:
        kind = InputError if failure["type"] == "InputError" else StageError
        raise kind(failure["message"])
    if code == 0:
        return
    if code < 0:
        raise CrashError(f"{job.title}: the process {how_it_ended(code)}; log: {job.log}")
    tail = " | ".join(_last_lines(job.log))
    raise StageError(f"{job.title}: the process {how_it_ended(code)}: {tail}; log: {job.log}")


def _verdict(file: Path) -> dict[str, str] | None:
    """Take what the child left when it failed; None where it could not leave that."""
    try:
        failure: dict[str, str] = json.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    file.unlink()
    return failure


def _last_lines(log: Path) -> list[str]:
    lines = [line.strip() for line in log.read_text("utf-8", errors="replace").splitlines()]
    return [line for line in lines if line][-LOG_TAIL_LINES:]


def _child(job: StageJob) -> int:
    """Run the operation; leave a verdict file when it fails."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a crash leaves a log, not gigabytes
    faulthandler.enable()
    # blocked in workers, as flows/services/dask_cluster.py says; what the stage starts may need it
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    module, _, function = job.operation.partition(":")
    status = StatusFile(job.status)
    try:
        operation: Operation = getattr(importlib.import_module(module), function)
        operation(job.arguments, job.out, job.threads, status.progress)
    except MattgsError as error:
        traceback.print_exc()
        _send(job, "InputError" if isinstance(error, InputError) else "StageError", str(error))
        return 1
    except Exception as error:
        traceback.print_exc()
        message = f"{job.title}: {type(error).__name__}: {error}; log: {job.log}"
        _send(job, "StageError", message)
        return 1
    return 0


def _send(job: StageJob, kind: str, message: str) -> None:
    path = job.log.with_suffix(".verdict.json")
    with written_whole(path) as partial:  # on a full disk there is none
        partial.write_text(json.dumps({"type": kind, "message": message}), encoding="utf-8")


def main(argv: list[str]) -> int:
    """Child's entry: ``JOB.json [PARENT_PID]``."""
    if len(argv) > 1:
        die_with_parent(int(argv[1]))
    return _child(StageJob.load(Path(argv[0])))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
