"""What each stage of a benchmark is doing right now, as small JSON files that anyone may read.

One file per stage, replaced atomically::

    {"title": "train rover nobg-ours seed 0", "stage": "train", "state": "running",
     "done": 300, "total": 1000, "note": "24.1 dB", "started": 1763…, "updated": 1763…, "anew": 0,
     "process": 4711, "machine": "desk", "key": "train/3f0c…"}

``state`` is ``waiting``, ``running``, ``done``, ``cached`` or ``failed``, and reads as
``interrupted`` where the process that ran the stage is gone; times are seconds since the epoch. A
benchmark writes its whole grid as waiting when it begins. The files serve people only: no result
depends on them, and losing them loses nothing.
"""

import json
import os
import time
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from socket import gethostname
from typing import Literal

from mattgs_ops.progress import Throttle
from mattgs_ops.whole_file import written_whole

State = Literal["waiting", "running", "interrupted", "done", "cached", "failed"]
THROTTLE_SECONDS = 0.5  # a progress report is written at most this often


@dataclass(frozen=True)
class Status:
    """How far one stage is: ``done`` of ``total`` units, in a ``state`` since ``started``."""

    title: str
    stage: str
    state: State = "waiting"
    done: int = 0
    total: int = 0
    note: str = ""
    started: float = 0.0
    updated: float = 0.0
    process: int = 0  # that sees to the stage
    machine: str = ""  # that it runs on
    key: str = ""  # its place in the store, also of the run before until this one asks for it
    anew: float = 0.0  # when its progress last fell back, as a further attempt's does; 0: never

    @property
    def seconds(self) -> float:
        """Seconds from start to the last report."""
        return max(0.0, self.updated - self.started)


class StatusFile:
    """Writes one stage's status; cheap to call often."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._throttle = Throttle(THROTTLE_SECONDS)

    def plan(self, title: str, stage: str) -> None:
        """State that the stage is to run."""
        before = read(self.path)
        self._write(Status(title, stage, key="" if before is None else before.key))

    def begin(self, title: str, stage: str, key: str = "") -> None:
        """State that the stage runs from now on."""
        now = time.time()
        status = Status(title, stage, "running", started=now, updated=now, key=key)
        self._write(replace(status, process=os.getpid(), machine=gethostname()))

    def progress(self, done: int, total: int, note: str) -> None:
        """Take an operation's report, see ``mattgs_ops/progress.py``.

        Of no account where another run of the same name has planned the stage anew.
        """
        if not self._throttle.passes(done, total):
            return
        status = read(self.path)
        if status is not None and status.state == "running":
            now = time.time()
            fell = status.total > 0 and done * status.total < status.done * total
            anew = now if fell else status.anew
            reported = replace(status, done=done, total=total, note=note, updated=now, anew=anew)
            self._write(reported)

    def end(self, state: State, note: str = "") -> None:
        """State how the stage ended, also where another run of the same name took its file away."""
        now = time.time()
        status = read(self.path) or Status(self.path.stem, "")
        done = status.total if state in ("done", "cached") else status.done
        began = status.started or now  # nobody knows when, where it was planned anew
        self._write(replace(status, state=state, done=done, note=note, started=began, updated=now))

    def end_elsewhere(
        self, title: str, stage: str, state: State, seconds: float, note: str = ""
    ) -> None:
        """State how a stage ended on a machine whose status files are not seen here."""
        before = read(self.path)
        if before is None or before.state == "waiting":
            now = time.time()
            self._write(Status(title, stage, state, 0, 0, note, now - seconds, now))

    def warn(self, note: str) -> None:
        """Leave a sentence with a stage that has ended well."""
        before = read(self.path)
        if before is not None and before.state in ("done", "cached"):
            self._write(replace(before, note=note))

    def restore(self, status: Status) -> None:
        """Put back what was there before."""
        self._write(status)

    def _write(self, status: Status) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(self.path, by_many=True) as partial:
            partial.write_text(json.dumps(asdict(status)), encoding="utf-8")


def read(path: Path) -> Status | None:
    """Return one stage's status; None when there is none (yet), or none that can be read."""
    try:
        file = path.stat()
        status = _parsed(path, file.st_mtime_ns, file.st_ino)
    except (OSError, ValueError, TypeError):
        return None
    if status.state == "running" and gone(status.process, status.machine):
        return replace(status, state="interrupted")
    return status


@lru_cache(maxsize=8192)
def _parsed(path: Path, changed: int, node: int) -> Status:
    """Read a file once; the terminal reads all of a grid's twice a second."""
    del changed, node
    return Status(**json.loads(path.read_text(encoding="utf-8")))


def gone(process: int, machine: str) -> bool:
    """Whether a process was one of this machine's and has ended."""
    if machine != gethostname():
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except PermissionError:  # another user's
        pass
    return False


def read_all(folder: Path) -> list[Status]:
    """Return the status of every stage below ``folder``: in order of start, waiting ones last."""
    read_files = [read(path) for path in sorted(folder.glob("*.json"))]
    stages = (status for status in read_files if status is not None)
    return sorted(stages, key=lambda s: (s.state == "waiting", s.started, s.title))
