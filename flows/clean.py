"""Which artifacts the recorded runs refer to, and the removal of all others; open runs closed."""

import time
from pathlib import Path

from flows import run_record
from flows.services import embedded, registries
from mattgs_ops.errors import InputError
from mattgs_ops.store.cleaning import Kind, Removal, clean
from mattgs_ops.store.store import Store
from tasks.registry import runs, summary
from tasks.registry.upkeep import orphans
from tasks.row import Row
from tasks.stages import status
from tasks.stages.stage import Place

UNITS = ("bytes", "kB", "MB", "GB", "TB")
PLURALS: dict[Kind, str] = {
    "artifact": "artifacts",
    "work folder": "work folders",
    "lock": "locks",
}


def clean_up(out: Path, *, unused_hours: float, dry_run: bool) -> str:
    """Remove from the store what no run refers to; return what was done, for people.

    Raises :class:`InputError` when the runs cannot be read: then nothing is known to be unused.
    """
    store = Store(Place(out, "").store)
    if not store.root.is_dir():
        raise InputError(f"{store.root}: expected a store, found none; --out names the folder")
    embedded.enter(out)
    since = time.time() - 3600 * unused_hours
    # first: it asks all registries, and nothing is changed unless all of them answer
    removed = clean(store, referred(out), unused_since=since, dry_run=dry_run)
    closed = (
        []
        if registries.existing(out) is None
        else [*_close(out, dry_run=dry_run), *_purge(out, dry_run=dry_run)]
    )
    return "\n".join([*closed, _summary(removed, dry_run=dry_run)])


def _close(out: Path, *, dry_run: bool) -> list[str]:
    """Close the runs that dead processes left open; one line each."""
    closed = orphans.close_orphans(registries.current(out), dry_run=dry_run)
    verb = "Would close" if dry_run else "Closed"
    return [f"{verb} as KILLED, its process is gone: {name}" for name in closed]


def _purge(out: Path, *, dry_run: bool) -> list[str]:
    """Remove the reports of summaries that were replaced; one line each."""
    purged = summary.purge(registries.current(out), dry_run=dry_run)
    verb = "Would remove" if dry_run else "Removed"
    return [
        f"{verb} from MLflow the report of a summary that was replaced: {i[:8]}" for i in purged
    ]


def referred(out: Path) -> set[str]:
    """Return the keys of all artifacts that MLflow's runs and the benchmarks' rows refer to.

    MLflow's are those of every registry that runs of this folder were recorded in. And of those
    that the newest run of a benchmark came to, where that has not ended. Raises
    :class:`InputError` where a registry is gone or does not answer.
    """
    rows = [row for path in sorted(out.glob("benchmarks/*/rows.json")) for row in _read(path)]
    for tracking in registries.everyone(out):
        try:
            rows += runs.all_rows(tracking)  # of all projects: the store is shared
        except InputError as error:
            where = out / registries.FILE
            raise InputError(f"{error}; nothing was removed ({where} names registries)") from error
    places = [place for row in rows for place in (row.get("artifacts") or {}).values()]
    return {"/".join(Path(place).parts[:2]) for place in places} | _to_be_gone_on_with(out)


def _to_be_gone_on_with(out: Path) -> set[str]:
    """Return the keys of the stages of runs that were interrupted: no row refers to them yet."""
    folders = sorted((out / "benchmarks").glob("*"))
    records = {folder.name: run_record.read(folder) for folder in folders}
    names = [name for name, record in records.items() if record and record.state != "ended"]
    stages = [one for name in names for one in status.read_all(Place(out, name).status)]
    return {one.key for one in stages if one.key}


def _read(path: Path) -> list[Row]:
    from reports.rows.schema import read_rows

    return list(read_rows(path))


def _summary(removed: list[Removal], *, dry_run: bool) -> str:
    """List what was removed, largest first, and sum it up."""
    lines = [
        f"{size(one.size):>10}  {one.name}"
        for one in sorted(removed, key=lambda one: (-one.size, one.name))
        if one.kind != "lock"
    ]
    counts = {kind: sum(one.kind == kind for one in removed) for kind in PLURALS}
    parts = [f"{n} {PLURALS[kind] if n != 1 else kind}" for kind, n in counts.items()]
    total = sum(one.size for one in removed)
    verb = "Would remove" if dry_run else "Removed"
    return "\n".join([*lines, f"{verb} {', '.join(parts)}: {size(total)} ({total} bytes)"])


def size(count: int) -> str:
    """Write a number of bytes as people do: ``1.5 MB``."""
    value = float(count)
    for unit in UNITS:
        if value < 1000 or unit == UNITS[-1]:
            break
        value /= 1000
    return f"{value:.0f} {unit}" if unit == UNITS[0] else f"{value:.1f} {unit}"
