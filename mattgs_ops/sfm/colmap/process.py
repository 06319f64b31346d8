"""Run the worker process, pass its progress on, and turn any way it ends into an answer or error.

COLMAP may abort, crash or raise from its own threads, and quarrels with other libraries that are
loaded beside it; none of that may end the caller.
"""

import json
import os
import re
import subprocess
import sys
from collections import deque
from pathlib import Path

from mattgs_ops.child_process import how_it_ended
from mattgs_ops.errors import InputError, StageError, full_among
from mattgs_ops.progress import Progress
from mattgs_ops.sfm.colmap.job import ANSWER_FILE, Answer, Job

WORKER = ("-P", "-m", "mattgs_ops.sfm.colmap.worker")
LAST_LINES = 12  # of the log, in an error's message
COLOURS = re.compile(r"\x1b\[[0-9;]*m")  # COLMAP's, for a terminal
# One thread per numeric library: the worker's own pool is the only parallelism
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run_worker(job: Job, log: Path, progress: Progress) -> Answer:
    """Run a job to its end; COLMAP's output goes to ``log``.

    Raises :class:`StageError` or :class:`InputError` with the worker's own message, and
    :class:`StageError` with the log's last lines when it crashed.
    """
    path = job.save()
    root = str(Path(__file__).resolve().parents[3])
    environment = os.environ | dict.fromkeys(THREAD_VARIABLES, "1")
    places = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
    environment["PYTHONPATH"] = os.pathsep.join(places)
    command = [sys.executable, *WORKER, str(path)]
    log.write_text("", encoding="utf-8")
    with (
        # appending, as both the worker and this process write to it
        log.open("a", encoding="utf-8") as errors,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
        ) as worker,
    ):
        try:
            failure = _listen(worker, log, progress)
            status = worker.wait()
        except BaseException:
            worker.kill()
            raise
    if failure is not None:
        raise failure
    if status != 0:
        raise StageError(_with_log(how_it_ended(status), log))
    if not (Path(job.workspace) / ANSWER_FILE).is_file():
        raise StageError(_with_log("ended without an answer", log))
    return Answer.load(Path(job.workspace))


def _listen(worker: "subprocess.Popen[str]", log: Path, progress: Progress) -> Exception | None:
    """Read the worker's lines until it closes them; returns the error that it reported, if any."""
    assert worker.stdout is not None
    failure: Exception | None = None
    for line in worker.stdout:
        try:
            message = json.loads(line)
        except json.JSONDecodeError:
            message = None
        if not isinstance(message, dict):  # something printed by a library
            with log.open("a", encoding="utf-8") as file:
                file.write(line)
        elif "error" in message:
            kind = InputError if message["kind"] == "InputError" else StageError
            failure = kind(message["error"])
        else:
            progress(message["done"], message["total"], message["note"])
    return failure


def _with_log(how: str, log: Path) -> str:
    with log.open(encoding="utf-8", errors="replace") as file:
        lines = "".join(deque(file, LAST_LINES)).rstrip() or "(the log is empty)"
    full = "".join(f"{place}: no room is left; " for place in full_among([log.parent]))
    plain = COLOURS.sub("", lines)
    return f"structure-from-motion: {full}its process {how}; the last lines of {log}:\n{plain}"
