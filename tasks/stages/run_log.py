"""Stage logs in the log of the Prefect run that performs the stage, so that the interface has them.

A stage writes to a file on its worker. While it runs, a thread reads that file and hands each new
line to Prefect's run logger, and now and then the stage's progress. Outside a Prefect run nothing
is read. The file stays complete; the interface gets the first :data:`MOST_LINES` lines of a stage.
"""

import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import copy_context
from pathlib import Path
from typing import Any

from tasks.stages.process import HEADER
from tasks.stages.status import read

POLL_SECONDS = 1.0
PROGRESS_SECONDS = 20.0  # between two lines of progress: a training of an hour has 180
MOST_LINES = 2000  # of one stage: COLMAP may print a line for each pair of photos
MOST_LETTERS = 2000  # of one line

Logger = logging.Logger | logging.LoggerAdapter[logging.Logger]


class RunLog:
    """The log of the current Prefect run; does nothing outside of one."""

    def __init__(self) -> None:
        self._logger = _logger()

    def info(self, text: str) -> None:
        """Write one line."""
        if self._logger is not None:
            self._logger.info("%s", text)

    @contextmanager
    def following(self, log: Path, status: Path) -> Iterator[None]:
        """Copy what is appended to ``log``, and the progress in ``status``, until the block ends.

        A failure of Prefect's log never reaches the stage.
        """
        if self._logger is None:
            yield
            return
        follower = _Follower(self._logger, log, status)
        # the settings that say where logs go are context variables
        thread = threading.Thread(
            target=copy_context().run, args=(follower.run,), name="run log", daemon=True
        )
        thread.start()
        try:
            yield
        finally:
            follower.over.set()
            thread.join()


def _logger() -> Logger | None:
    """Return the current run's logger; None outside a run, without importing Prefect for that."""
    if "prefect" not in sys.modules:
        return None
    from prefect.exceptions import MissingContextError
    from prefect.logging import get_run_logger

    try:
        return get_run_logger()
    except MissingContextError:
        return None


class _Follower:
    def __init__(self, logger: Logger, log: Path, status: Path) -> None:
        self.over = threading.Event()
        self._logger = logger
        self._log = log
        self._status = status
        self._offset = log.stat().st_size if log.is_file() else 0  # earlier attempts' lines
        self._rest = b""
        self._lines = 0
        self._last_progress: tuple[Any, ...] = ()

    def run(self) -> None:
        waited = 0.0
        while not self.over.wait(POLL_SECONDS):
            self._copy()
            waited += POLL_SECONDS
            if waited >= PROGRESS_SECONDS:
                waited = 0.0
                self._progress()
        self._copy(last=True)
        self._progress()

    def _copy(self, *, last: bool = False) -> None:
        if not self._log.is_file():
            return
        with self._log.open("rb") as file:
            file.seek(self._offset)
            new = file.read()
        self._offset += len(new)
        *lines, self._rest = (self._rest + new).replace(b"\r", b"\n").split(b"\n")
        if last:
            lines.append(self._rest)
        for line in lines:
            self._write(line.decode("utf-8", errors="replace").rstrip())

    def _write(self, line: str) -> None:
        if not line or line.startswith(HEADER):
            return
        self._lines += 1
        if self._lines <= MOST_LINES:
            self._logger.info("%s", line[:MOST_LETTERS])
        elif self._lines == MOST_LINES + 1:
            self._logger.info("further lines are in %s only", self._log)

    def _progress(self) -> None:
        now = read(self._status)
        if now is None or (now.done, now.note) == self._last_progress:
            return
        self._last_progress = (now.done, now.note)
        share = f"{now.done} of {now.total}" if now.total else ""
        text = ": ".join(part for part in (share, now.note) if part)
        if text:
            self._logger.info("%s", text)
