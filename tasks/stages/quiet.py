"""Quiet on this machine: speed is measured when no stage of any benchmark runs here.

Two files in the temporary folder are locked by the kernel, so a killed process frees them. Every
stage holds ``work`` shared while it runs; measuring holds it alone. Whoever wants ``work`` passes
``gate`` first, and measuring keeps ``gate`` while it waits: it waits for the stages that run, not
for those that would follow.

All benchmarks of a user must find the same files, so their place can be guessed, and on a shared
machine anybody may put something there first. Hence the folder is used only if it is a real folder,
ours, and closed to others; links are not followed, neither to it nor in it.
"""

import fcntl
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from mattgs_ops.errors import InputError

LONGEST_TEXT = 1000  # bytes that are read of a lock's file
OTHERS = stat.S_IRWXG | stat.S_IRWXO  # what others may do, none of which is wanted


@contextmanager
def busy(waiting: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Work beside others, but not while somebody measures: then ``waiting`` is called first."""
    with ExitStack() as gate:
        try:
            gate.enter_context(locked("gate", fcntl.LOCK_EX | fcntl.LOCK_NB))
        except BlockingIOError:
            waiting()
            gate.enter_context(locked("gate", fcntl.LOCK_EX))
        work = locked("work", fcntl.LOCK_SH)
        work.__enter__()
    try:
        yield
    finally:
        work.__exit__(None, None, None)


@contextmanager
def alone() -> Iterator[None]:
    """Wait until every running stage has ended, and keep others from starting."""
    with locked("gate", fcntl.LOCK_EX), locked("work", fcntl.LOCK_EX):
        yield


def _folder() -> Path:
    return Path(tempfile.gettempdir()) / f"mattgs-{os.getuid()}"


@contextmanager
def locked(name: str, kind: int) -> Iterator[int]:
    """Hold the machine's lock of that name, and yield its file's descriptor.

    ``kind`` is as for ``flock``, whose errors are raised.
    """
    with _opened(_folder()) as folder:
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            file = os.open(name, flags, 0o600, dir_fd=folder)
        except OSError as error:
            raise InputError(f"{_folder() / name}: expected a file to lock: {error}") from error
    try:
        fcntl.flock(file, kind)
        yield file
    finally:
        os.close(file)


def written_in(name: str) -> str:
    """Return what whoever holds the lock of that name has written into its file."""
    with _opened(_folder()) as folder:
        file = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder)
    try:
        return os.read(file, LONGEST_TEXT).decode(errors="replace")
    finally:
        os.close(file)


@contextmanager
def _opened(place: Path) -> Iterator[int]:
    """Open the folder of the locks, made if need be; yields its descriptor.

    Raises :class:`InputError` when somebody else may have a hand in it.
    """
    expected = f"{place}: expected a folder of user {os.getuid()} that others cannot enter"
    remedy = "remove it, or set TMPDIR to a folder of your own"
    try:
        place.mkdir(mode=0o700, exist_ok=True)
        folder = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError as error:
        found = "a link" if place.is_symlink() else str(error)
        raise InputError(f"{expected}, found {found}; {remedy}") from error
    try:
        state = os.fstat(folder)
        if state.st_uid != os.getuid() or state.st_mode & OTHERS:
            found = f"one of user {state.st_uid} with mode {stat.S_IMODE(state.st_mode):o}"
            raise InputError(f"{expected}, found {found}; {remedy}")
        yield folder
    finally:
        os.close(folder)
