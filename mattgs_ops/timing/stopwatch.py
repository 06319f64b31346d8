"""A clock for measuring on machines that others use too.

It is the wall clock without the time that the calling thread stood in the queue for a processor
(Linux: ``/proc/thread-self/schedstat``, its second number). Work counts, sleeping and waiting for
files count; a busy neighbour that took the core does not. Threads that the caller waits for are not
looked at: exact for work on one thread. Where the kernel does not tell, it is the wall clock.
"""

import time
from pathlib import Path

QUEUE_FILE = Path("/proc/thread-self/schedstat")
NANOSECONDS = 1e-9
MOST_READINGS = 20


def seconds() -> float:
    """Return undisturbed seconds since some fixed moment; only differences mean something.

    Both clocks are read at one moment: a wait between the two readings asks for new ones.
    """
    before = queued()
    for _ in range(MOST_READINGS):
        now, after = time.perf_counter(), queued()
        if after == before:
            break
        before = after
    return now - before


def queued(file: Path = QUEUE_FILE) -> float:
    """Return the seconds that this thread waited for a processor so far; 0 where unknown."""
    try:
        return int(file.read_text(encoding="ascii").split()[1]) * NANOSECONDS
    except (OSError, ValueError, IndexError):
        return 0.0
