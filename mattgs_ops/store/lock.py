"""Kernel locks on files, whose dates say when they were last asked for.

A killed owner frees its lock. Whoever tidies up may remove a lock's file while holding it. Not
``filelock``: it removes the file on release, and with it the date, and it polls instead of waiting.
"""

import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

log = logging.getLogger(__name__)


@contextmanager
def held(path: Path, wait: bool) -> Iterator[bool]:
    """Hold the lock at ``path``, waiting for it, and date it; yields whether it is held.

    Without ``wait`` yields False at once when another has it, and leaves the date alone.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        with path.open("ab") as file:
            if not _acquire(file, wait, path.name):
                yield False
                return
            # whoever cleans removes lock files while holding them: take the one now there
            if is_at(file, path):
                if wait:
                    _date(file)
                yield True
                return


def _acquire(file: IO[bytes], wait: bool, name: str) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if not wait:
            return False
        log.info("%s: another process is at it; waiting for its result", name)
        fcntl.flock(file, fcntl.LOCK_EX)
    return True


def _date(file: IO[bytes]) -> None:
    """Say that a lock is in use now; one byte tells it from a lock that was only tidied up."""
    if os.fstat(file.fileno()).st_size == 0:
        file.write(b".")
        file.flush()
    os.utime(file.fileno())


def is_at(file: IO[bytes], path: Path) -> bool:
    """Whether an open file is the one that lies at ``path`` now."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
