"""Processes that work for another one: they end with it, and how they ended is told in words."""

import ctypes
import os
import signal
import sys
from collections.abc import Callable

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def death_with_parent() -> Callable[[], int]:
    """Return a call by which a process ends with the thread that started it; 0 when it is set.

    For use between fork and exec: the call itself takes no lock, so that other threads cannot make
    it hang. Only Linux has it; elsewhere nothing is set.
    """
    if sys.platform != "linux":
        return lambda: 0
    libc = ctypes.CDLL(None, use_errno=True)
    return lambda: int(libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0))


def die_with_parent(parent: int) -> None:
    """Have the kernel kill this process when the thread that started it ends.

    Exits at once when ``parent``, the expected parent's process id, is already gone.
    """
    if death_with_parent()() != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG) failed")
    if os.getppid() != parent:
        sys.exit("the process that started this one is gone")


def how_it_ended(status: int) -> str:
    """Say how a process ended; a negative status is minus the signal's number."""
    if status >= 0:
        return f"ended with status {status}"
    try:
        name = signal.Signals(-status).name
    except ValueError:  # real-time signals have no name of their own
        name = f"signal {-status}"
    return f"was ended by {name}{' (out of memory?)' if name == 'SIGKILL' else ''}"
