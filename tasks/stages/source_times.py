"""When the code was last changed: says whether what a process has imported is still there."""

import os
from collections.abc import Iterator
from pathlib import Path

import mattgs_ops
import tasks

SOURCE_SUFFIXES = (".py", ".cpp", ".h", ".so")

SourceTimes = tuple[tuple[str, int], ...]  # path and time of change, nanoseconds


def source_times() -> SourceTimes:
    """Return the times of all sources of stages; cheap enough for every stage."""
    roots = [Path(path) for package in (mattgs_ops, tasks) for path in package.__path__]
    return tuple(sorted(found for root in roots for found in _below(str(root))))


def _below(folder: str) -> Iterator[tuple[str, int]]:
    """Yield the sources below a folder; by names, as every stage asks for them."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                yield from _below(entry.path)
            elif entry.name.endswith(SOURCE_SUFFIXES):
                yield entry.path, entry.stat().st_mtime_ns
