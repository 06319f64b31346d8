"""The cores that are ours, shared by all stages of all benchmarks: never more threads than cores.

One file per core, locked by the kernel, so a killed process frees it. It says who holds the core,
for those who wait. A stage holds as many as it has threads. One whose work can be spread also takes
cores that are free when it begins; what a stage computes never depends on how many it got.
"""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from tasks.stages.quiet import locked, written_in

RETRY_SECONDS = 0.2  # between looks for a free core


def own_cores() -> int:
    """Return how many cores are ours: a batch system or a container may give fewer than all.

    A container's share of CPU time counts as Dask counts it, a part of a core as a whole one.
    """
    from dask.system import cpu_count  # not for those that only ask for the command's help

    return int(cpu_count())


@contextmanager
def taken(
    least: int,
    most: int,
    holder: str = "",
    waiting: Callable[[list[str]], None] = lambda _: None,
) -> Iterator[int]:
    """Hold ``least`` to ``most`` cores, waiting for the least; yields how many threads to use.

    Where this process may use fewer than ``least``, it holds all of those. ``holder`` says whose
    the cores then are; while there are too few, ``waiting`` is called with whose they are,
    and again when that changes.
    """
    names = _names()
    needed = min(least, len(names))
    most = max(needed, most)
    with ExitStack() as held:
        count, holders = _take(held, names, needed, most, holder)
        told = None
        while count < needed:
            if holders != told:
                waiting(holders)
                told = holders
            time.sleep(RETRY_SECONDS)
            count, holders = _take(held, names, needed, most, holder)
        yield max(least, count)


def holders() -> list[str]:
    """Return who holds cores of this machine, each once."""
    names = _names()
    with ExitStack() as held:
        return _take(held, names, len(names), len(names), "")[1]


def _names() -> list[str]:
    return [f"core-{number}" for number in sorted(os.sched_getaffinity(0))][: own_cores()]


def _take(
    held: ExitStack, names: list[str], needed: int, most: int, holder: str
) -> tuple[int, list[str]]:
    """Lock free cores, up to ``most``, or none where fewer than ``needed`` are.

    Returns how many, and who holds the others, each once.
    """
    # one chooses at a time: two that hold half of what they need would wait for each other
    with locked("cores", fcntl.LOCK_EX), ExitStack() as locks:
        count = 0
        others: dict[str, None] = {}
        for name in names:
            if count == most:
                break
            if _try(locks, name, holder):
                count += 1
            else:
                others[written_in(name)] = None
        if count < needed:
            return 0, list(others)
        held.push(locks.pop_all())
        return count, list(others)


def _try(locks: ExitStack, name: str, holder: str) -> bool:
    try:
        file = locks.enter_context(locked(name, fcntl.LOCK_EX | fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    os.ftruncate(file, 0)
    os.pwrite(file, holder.encode(), 0)
    return True
