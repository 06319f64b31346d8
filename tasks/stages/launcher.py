"""Stages that start in milliseconds: a process that has imported what they need, and forks them.

Importing torch and what comes with it takes more than two processor seconds, and a benchmark starts
two processes per experiment. A :class:`Launcher` pays once. Isolation stays what it was: every
stage is a process of its own, in its own session, with its own log and environment. It may crash,
be killed or leak without a trace in the next one.

A process with threads cannot be forked safely, so the launcher imports and does nothing else; a
module that starts threads when it is imported (ONNX Runtime) is refused. Stages that need one start
in a fresh process (``process.py``).

The launcher (``python -m tasks.stages.launcher``) reads one request per line, JSON, from its
standard input: ``job`` (file), ``imports``, ``threads``, ``environment``, ``path``, ``folder``,
``log``. It answers with ``{"process": ID}``, and when that ended with ``{"code": CODE}``, negative
for a signal. It dies with the thread that started it, and its stages die with it.
"""

import gc
import importlib
import json
import os
import select
import subprocess
import sys
import tempfile
import threading
import traceback
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from signal import SIGKILL
from typing import IO, Any, cast

from mattgs_ops.child_process import die_with_parent
from tasks.stages.source_times import SourceTimes, source_times

OWN_THREADS = Path("/proc/self/task")


class Launched:
    """A stage's process; waits like :class:`subprocess.Popen`."""

    def __init__(self, launcher: "Launcher", process: int) -> None:
        self.pid = process
        self._launcher = launcher
        self._code: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, None while the process runs."""
        try:
            return self.wait(0)
        except subprocess.TimeoutExpired:
            return None

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code; raises :class:`subprocess.TimeoutExpired`."""
        if self._code is None:
            self._code = self._launcher.code(timeout)
        return self._code


class Launcher:
    """The caller's end of a launcher process."""

    def __init__(self, environment: Mapping[str, str], log: IO[bytes]) -> None:
        self.sources = source_times()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            env=dict(environment),
            start_new_session=True,  # spared Ctrl-C
        )
        self._input = cast(IO[bytes], self._process.stdin)
        self._output = _answers(cast(IO[bytes], self._process.stdout))
        weakref.finalize(self, _close, self._process)

    def fresh(self, sources: SourceTimes) -> bool:
        """Whether it runs, and what it imports is what lies on the disk."""
        return self._process.poll() is None and self.sources == sources

    def start(self, request: Mapping[str, Any]) -> Launched | int:
        """Start a stage; returns its exit code instead where the launcher ended before."""
        try:
            self._input.write(json.dumps(request).encode() + b"\n")
            self._input.flush()
        except BrokenPipeError:
            return self._own_code()
        line = self._output.readline()
        return Launched(self, json.loads(line)["process"]) if line else self._own_code()

    def code(self, timeout: float | None) -> int:
        """Wait for the started stage's exit code; it is the launcher's own where that ended."""
        ready, _, _ = select.select([self._output], [], [], timeout)
        if not ready:
            raise subprocess.TimeoutExpired("stage", timeout or 0)
        line = self._output.readline()
        return int(json.loads(line)["code"]) if line else self._own_code()

    def _own_code(self) -> int:
        return self._process.wait() or -SIGKILL


def _answers(stream: IO[bytes]) -> IO[bytes]:
    """Read a launcher's answers without a buffer, where ``select`` would not see the second one.

    A stage may end before its start was read: both answers lie in the pipe then.
    """
    return open(stream.fileno(), "rb", buffering=0, closefd=False)


def _close(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    process.wait()


_OF_THREAD = threading.local()  # a launcher dies with the thread that started it


def launch(
    request: Mapping[str, Any], environment: Mapping[str, str], log: IO[bytes]
) -> Launched | int:
    """Start a stage from this thread's launcher, a new one where that is gone or out of date.

    ``environment`` is that of a launcher that has to be started.
    """
    running: Launcher | None = getattr(_OF_THREAD, "launcher", None)
    if running is None or not running.fresh(source_times()):
        running = _OF_THREAD.launcher = Launcher(environment, log)
    return running.start(request)


def serve(answers: IO[str]) -> None:
    """Read requests until the caller goes away."""
    for line in sys.stdin:
        request = json.loads(line)
        sys.path[:] = request["path"]
        _import(request["imports"])
        process = os.fork()
        if process == 0:
            answers.close()
            _become(request)
        print(json.dumps({"process": process}), file=answers, flush=True)
        _, status = os.waitpid(process, 0)
        print(json.dumps({"code": os.waitstatus_to_exitcode(status)}), file=answers, flush=True)


def _import(modules: Sequence[str]) -> None:
    """Import what the stage will need; what fails here fails again there, with a message."""
    for name in modules:
        with suppress(Exception):
            importlib.import_module(name)
    if len(list(OWN_THREADS.iterdir())) > 1:
        sys.exit(f"one of {', '.join(modules)} started threads when it was imported")
    gc.freeze()  # the collector would write to every page that stages share


def _become(request: Mapping[str, Any]) -> None:
    """Turn the forked process into the stage's; never returns."""
    code = 1
    try:
        parent = os.getppid()
        os.setsid()
        log = os.open(request["log"], os.O_WRONLY | os.O_APPEND)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for source, target in ((nothing, 0), (log, 1), (log, 2)):
            os.dup2(source, target)
        os.environ.clear()
        os.environ.update(request["environment"])
        os.chdir(request["folder"])
        tempfile.tempdir = None  # as the environment says
        from tasks.stages import process

        die_with_parent(parent)
        _use_threads(int(request["threads"]))
        code = process.main([request["job"]])
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)  # the launcher's own exit handlers are not this process's


def _use_threads(count: int) -> None:
    """Give the imported libraries the stage's threads; none was started so far."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(count)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(count)


def main(parent: int) -> None:
    """Serve the process ``parent``."""
    die_with_parent(parent)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print when they are imported is no answer
    serve(answers)


if __name__ == "__main__":
    main(int(sys.argv[1]))
