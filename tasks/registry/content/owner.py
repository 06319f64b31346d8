"""Which process a run under way belongs to, and whether that process still lives.

An owner is written ``MACHINE PROCESS BEGAN``, for example ``bench-1 4711 1763730000``: the system
reuses process numbers, but not together with the second in which a process began. A process of
another machine cannot be looked at from here and counts as alive.
"""

import os
import socket

import psutil

SLACK = (
    5.0  # seconds that two readings of a beginning may differ: clocks are set while machines run
)


def owner() -> str:
    """Name this process."""
    return f"{socket.gethostname()} {os.getpid()} {psutil.Process().create_time():.0f}"


def is_dead(text: str) -> bool:
    """Whether the owner is a process of this machine that has ended."""
    machine, number, began = [*text.rsplit(" ", 2), "", ""][:3]
    if machine != socket.gethostname() or not number.isdigit() or not began.isdigit():
        return False
    try:
        process = psutil.Process(int(number))
        zombie = bool(process.status() == psutil.STATUS_ZOMBIE)
        return zombie or abs(float(process.create_time()) - int(began)) > SLACK
    except psutil.NoSuchProcess:
        return True
    except psutil.AccessDenied:
        return False
