"""By which clock trainings are compared: the wall's, or the processor's.

A training that shared its cores with other work took longer by the wall clock through no fault of
its own. Where that shows in any row, all rows of a report are compared by CPU time.
"""

from collections.abc import Sequence
from typing import Any

from reports.rows.schema import Row

WALL, CPU = "time", "time_cpu"  # metrics
WORDS = {WALL: "time", CPU: "CPU time"}
AXES = {WALL: "Time (s)", CPU: "CPU time (s)"}
# Wall time over CPU time per thread. Two threads of the engine do the work of 1.8 to 2
# (docs/engine.md): a half more than none at all is no matter of threads.
WAITED = 1.5


def waited(row: Row) -> bool:
    """Say whether a training waited for its cores for a third of its wall time or more."""
    metrics: dict[str, Any] = row.get("metrics") or {}
    wall, cpu = float(metrics.get(WALL) or 0), float(metrics.get(CPU) or 0)
    threads = int((row.get("provenance") or {}).get("threads") or 1)
    return cpu > 0 and wall * threads > WAITED * cpu


def clock_of(rows: Sequence[Row]) -> str:
    """Return the metric by which the times of these rows compare."""
    finished = [row for row in rows if row["status"] == "finished"]
    known = all(row["metrics"].get(CPU) for row in finished)
    return CPU if known and any(waited(row) for row in finished) else WALL


def clock_notes(rows: Sequence[Row]) -> list[str]:
    """Say that wall times hold waiting, where they do."""
    finished = [row for row in rows if row["status"] == "finished"]
    late = sum(waited(row) for row in finished)
    if not late:
        return []
    other = (
        "claims and figures go by CPU time instead"
        if clock_of(rows) == CPU
        else "not all rows know their CPU time"
    )
    return [
        (
            f"Time is not to be trusted here: other work ran beside the trainings, and {late} of "
            f"{len(finished)} waited for their cores for a third of it or more; {other}."
        )
    ]
