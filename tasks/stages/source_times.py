"""When the code was last changed: says whether what a process has imported is still there."""

from pathlib import Path

import mattgs_ops
import tasks

SOURCE_SUFFIXES = {".py", ".cpp", ".h", ".so"}

SourceTimes = tuple[tuple[str, int], ...]  # path and time of change, nanoseconds


def source_times() -> SourceTimes:
    """Return the times of all sources of stages; cheap enough for every stage."""
    roots = [Path(path) for package in (mattgs_ops, tasks) for path in package.__path__]
    sources = sorted(p for root in roots for p in root.rglob("*") if p.suffix in SOURCE_SUFFIXES)
    return tuple((str(path), path.stat().st_mtime_ns) for path in sources)
