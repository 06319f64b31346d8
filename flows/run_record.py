"""Which run of a benchmark wrote its rows: begun, ended or broken off, in one small file.

``benchmarks/NAME/run.json`` belongs to the newest run: one that began before it and still works
leaves it alone, and is named in it (``beside``). Call :func:`problem` before
judging rows: a run that broke off leaves the rows of the one before, which say nothing of it.
"""

import json
import os
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from socket import gethostname
from typing import Any, Literal
from uuid import uuid4

from mattgs_ops.store.digests import file_digest
from mattgs_ops.whole_file import written_whole
from tasks.stages.status import gone

FILE, ROWS = "run.json", "rows.json"
State = Literal["running", "ended", "broken"]


@dataclass(frozen=True)
class RunRecord:
    """One run; ``rows`` is the digest of the rows that it wrote, ``sitting`` what it measures as.

    ``sitting`` is None where speeds that are known are taken as they are. ``process`` is the one
    that runs it, on ``machine``; ``beside`` those of other runs that were at work on that machine.
    """

    id: str
    state: State
    began: str
    ended: str | None = None
    reason: str = ""
    rows: str | None = None
    sitting: str | None = None
    process: int = 0
    machine: str = ""
    beside: tuple[tuple[int, str], ...] = ()


def begin(folder: Path, run: str | None = None, *, remeasure: bool = False) -> RunRecord:
    """Write and return the record of a run that begins now, called ``run`` or anything new.

    One that remeasures goes on with the sitting of the run before where that did not come to its
    end, so that the same command goes on after an interruption.
    """
    before = read(folder)
    name = run or uuid4().hex
    sitting = None
    if remeasure:
        left = before is not None and before.state != "ended" and before.sitting
        sitting = left or name
    here: dict[str, Any] = {"process": os.getpid(), "machine": gethostname()}
    record = RunRecord(name, "running", _now(), sitting=sitting, beside=_at_work(before), **here)
    _write(folder, record)
    return record


def _at_work(before: RunRecord | None) -> tuple[tuple[int, str], ...]:
    """Return the processes of other runs that surely live: those of this machine that are there."""
    if before is None:
        return ()
    newest = [(before.process, before.machine)] if before.state == "running" else []
    own, here = os.getpid(), gethostname()
    others = [one for one in (*newest, *before.beside) if one != (own, here)]
    return tuple(one for one in others if one[1] == here and not gone(*one))


def end(folder: Path, record: RunRecord, reason: str = "") -> None:
    """Note that a run has ended, or broke off for a reason; a newer run's record stays."""
    now = read(folder)
    if now is not None and now.id != record.id:
        return
    rows = folder / ROWS
    if reason or not rows.is_file():
        reason = reason or "it wrote no rows"
        _write(folder, replace(record, state="broken", ended=_now(), reason=reason))
    else:
        _write(folder, replace(record, state="ended", ended=_now(), rows=file_digest(rows)))


def read(folder: Path) -> RunRecord | None:
    """Return the record of the newest run; None where there is none, or none that can be read."""
    try:
        values = json.loads((folder / FILE).read_text(encoding="utf-8"))
        beside = tuple((int(process), str(name)) for process, name in values.pop("beside", ()))
        return RunRecord(**values, beside=beside)
    except (OSError, ValueError, TypeError, AttributeError):
        return None


def over(folder: Path) -> bool:
    """Whether the newest run ended, broke off or was killed, and none works that began before it.

    False where nothing tells.
    """
    record = read(folder)
    if record is None or not all(gone(*one) for one in record.beside):
        return False
    return record.state != "running" or gone(record.process, record.machine)


def broken_off(folder: Path) -> str:
    """Say why the newest run did not come to its end; empty where it did, or is under way."""
    record = read(folder)
    if record is None or record.state == "ended":
        return ""
    lives = record.state == "running" and not gone(record.process, record.machine)
    return "" if lives else problem(folder)


def problem(folder: Path, run: str | None = None) -> str:
    """Say why the rows in ``folder`` are not those of a run that ended; empty where they are.

    With ``run`` they must be of that very run; without, rows without a record are accepted.
    """
    record = read(folder)
    if record is None:
        return f"run {run} has left no record in {folder}: it never began" if run else ""
    if run is not None and record.id != run:
        return f"the rows are of the run {record.id}, begun {record.began}, not of {run}"
    if record.state == "running" and gone(record.process, record.machine):
        return f"the run {record.id}, begun {record.began}, has not ended: its process is gone"
    if record.state == "running":
        return (
            f"the run {record.id}, begun {record.began}, has not ended: it is under way, or it was "
            "killed; the rows are of an earlier one"
        )
    if record.state == "broken":
        return f"the run {record.id}, begun {record.began}, broke off: {record.reason}"
    if run is not None and record.rows != file_digest(folder / ROWS):
        return f"the rows are not those that the run {run} wrote"
    return ""


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _write(folder: Path, record: RunRecord) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with written_whole(folder / FILE, by_many=True) as partial:
        partial.write_text(json.dumps(asdict(record), indent=1) + "\n", encoding="utf-8")
