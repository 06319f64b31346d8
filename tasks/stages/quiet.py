"""Quiet on this machine: speed is measured when no stage of any benchmark runs here.

Two files in the temporary folder are locked by the kernel, so a killed process frees them. Every
stage holds ``work`` shared while it runs; measuring holds it alone. Whoever wants ``work`` passes
``gate`` first, and measuring keeps ``gate`` while it waits: it waits for the stages that run, not
for those that would follow.
"""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def busy() -> Iterator[None]:
    """Work beside others, but not while somebody measures."""
    with _locked("gate", fcntl.LOCK_EX):
        work = _locked("work", fcntl.LOCK_SH)
        work.__enter__()
    try:
        yield
    finally:
        work.__exit__(None, None, None)


@contextmanager
def alone() -> Iterator[None]:
    """Wait until every running stage has ended, and keep others from starting."""
    with _locked("gate", fcntl.LOCK_EX), _locked("work", fcntl.LOCK_EX):
        yield


def _folder() -> Path:
    return Path(tempfile.gettempdir()) / f"mattgs-{os.getuid()}"


@contextmanager
def _locked(name: str, kind: int) -> Iterator[None]:
    _folder().mkdir(mode=0o700, exist_ok=True)
    with (_folder() / name).open("w") as file:
        fcntl.flock(file, kind)
        yield
