"""Typed errors that a user can act on.

Every message names the file or the field, what was expected and what was found. An error of the
disk becomes such a message here: Python names no file where writing to an open one fails.
"""

import errno
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT)
OF_THE_DISK = (*FULL, errno.EFBIG, errno.EIO)
ROOM = 1 << 20  # bytes; with less a file system counts as full: a page of a report needs as much


class MattgsError(Exception):
    """Base of all errors that the project raises on purpose."""


class InputError(MattgsError):
    """The user's input cannot be used; raised before any long work starts."""


class StageError(MattgsError):
    """A stage ran and failed; the experiment becomes a row with this reason."""


def full_among(places: Iterable[Path]) -> list[Path]:
    """Return the places on file systems without room, each file system once.

    A place that is not there yet stands for the nearest folder above it that is.
    """
    found: dict[int, Path] = {}
    for place in places:
        nearest = next((one for one in (place, *place.absolute().parents) if one.exists()), None)
        if nearest is not None and shutil.disk_usage(nearest).free < ROOM:
            found.setdefault(nearest.stat().st_dev, nearest)
    return list(found.values())


def of_the_disk(error: OSError, places: Iterable[Path]) -> str | None:
    """Say what the disk's error is and where; None for errors that are not the disk's.

    ``places`` are asked for room where the error names no file.
    """
    if error.errno is None or error.errno not in OF_THE_DISK:
        return None
    reason = os.strerror(error.errno)
    if error.errno == errno.EFBIG:
        reason += " (a limit on the size of files, `ulimit -f`, or the file system's)"
    if error.filename is not None:
        return f"{error.filename}: {reason}"
    full = full_among(places) if error.errno in FULL else []
    return f"{', '.join(map(str, full))}: {reason}" if full else reason
