"""The cores of this machine, shared by all stages of all benchmarks: never more threads than cores.

One file per core, locked by the kernel, so a killed process frees it. A stage holds as many as it
has threads. One whose work can be spread also takes cores that are free when it begins; what a
stage computes never depends on how many it got.
"""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from tasks.stages.quiet import locked

RETRY_SECONDS = 0.2  # between looks for a free core


@contextmanager
def taken(least: int, most: int) -> Iterator[int]:
    """Hold ``least`` to ``most`` cores, waiting for the least; yields how many threads to use.

    Where this process may use fewer than ``least``, it holds all of those.
    """
    names = [f"core-{number}" for number in sorted(os.sched_getaffinity(0))]
    needed = min(least, len(names))
    most = max(needed, most)
    with ExitStack() as held:
        count = _take(held, names, needed, most)
        while count < needed:
            time.sleep(RETRY_SECONDS)
            count = _take(held, names, needed, most)
        yield max(least, count)


def _take(held: ExitStack, names: list[str], needed: int, most: int) -> int:
    """Lock free cores, up to ``most``, or none where fewer than ``needed`` are; return how many."""
    # one chooses at a time: two that hold half of what they need would wait for each other
    with locked("cores", fcntl.LOCK_EX), ExitStack() as locks:
        count = 0
        for name in names:
            if count < most:
                count += _try(locks, name)
        if count < needed:
            return 0
        held.push(locks.pop_all())
        return count


def _try(locks: ExitStack, name: str) -> bool:
    try:
        locks.enter_context(locked(name, fcntl.LOCK_EX | fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True
