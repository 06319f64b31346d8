"""``mattgs status``: per experiment, what each of its stages is doing, or how it ended."""

import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from flows import run_record
from flows.cli.terminal import MARKS, duration
from flows.grid import OF_A_CAPTURE, OF_AN_EXPERIMENT, SPEED, TRUTH, Experiment, experiments
from mattgs_ops.errors import InputError
from tasks.stages import status
from tasks.stages.status import State, Status

STYLES: dict[State, str] = {
    "done": "green",
    "cached": "green",
    "running": "yellow",
    "interrupted": "red",
    "failed": "red",
}
NARROWEST = 100  # columns, where no terminal says how wide it is


def print_status(out: Path, benchmark: str | None) -> None:
    """Print one table per benchmark; raises :class:`InputError` when there is none."""
    folder = out / "status"
    names = sorted(path.name for path in folder.glob("*") if path.is_dir())
    if not names or (benchmark is not None and benchmark not in names):
        wanted = "any benchmark" if benchmark is None else f"benchmark {benchmark!r}"
        raise InputError(f"{out}: no status of {wanted}; there is: {', '.join(names) or 'none'}")
    console = Console()
    if not console.is_terminal:
        console = Console(width=max(console.width, NARROWEST))
    for name in names if benchmark is None else [benchmark]:
        record = out / "benchmarks" / name
        progress = experiments(status.read_all(folder / name), over=run_record.over(record))
        _print(name, progress, run_record.broken_off(record), console)


def _print(name: str, progress: list[Experiment], broken_off: str, console: Console) -> None:
    counts = Counter(one.state for one in progress)
    states = ", ".join(f"{counts[state]} {state}" for state in sorted(counts))
    noun = "experiment" if len(progress) == 1 else "experiments"
    console.print(f"Benchmark {name}: {len(progress)} {noun}: {states}", highlight=False)
    if broken_off:
        console.print(f"! {broken_off}", style="yellow", markup=False, highlight=False)
    captures = {one.name.partition(" ")[0]: one for one in progress}
    shared = _table("Capture", _kinds(progress, (*OF_A_CAPTURE, SPEED)))
    for capture, one in captures.items():
        _add_row(shared, one, capture)
    console.print(shared)
    own = _table("Experiment", ["State", *_kinds(progress, (TRUTH, *OF_AN_EXPERIMENT))])
    for one in progress:
        _add_row(own, one, one.name, one.state, style=STYLES.get(one.state))
    console.print(own)
    stages = [stage for one in progress for stage in one.stages.values()]
    notes = {s.title: s.note for s in stages if s.state == "failed"}
    for stage, note in notes.items():
        console.print(f"{MARKS['failed']} {stage}: {note}", style="red", markup=False)
    ended = {s.title: s for s in stages if s.note}
    for title, one_stage in ended.items():
        if one_stage.state in ("done", "cached"):
            console.print(f"! {title}: {one_stage.note}", style="yellow", markup=False)


def _kinds(progress: list[Experiment], kinds: Iterable[str]) -> list[str]:
    """Return those of the kinds of stages that any experiment has, in order of work."""
    there = dict.fromkeys(kind for one in progress for kind in one.stages)
    return [kind for kind in there if kind in set(kinds)]


def _table(first: str, headings: Iterable[str]) -> Table:
    """Return a table that is read at 80 columns: the names in it are broken, never cut."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, overflow="fold")
    for heading in headings:
        table.add_column(heading, no_wrap=True)
    return table


def _add_row(table: Table, one: Experiment, *words: str, style: str | None = None) -> None:
    """Add ``words``, and a cell for each stage that the table has a column for."""
    kinds = [str(column.header) for column in table.columns[len(words) :]]
    table.add_row(*words, *(_cell(one.stages.get(kind)) for kind in kinds), style=style)


def _cell(stage: Status | None) -> str:
    """Say in a word what a stage does or how it ended."""
    if stage is None or stage.state == "waiting":
        return ""
    if stage.state == "running":
        share = f"{100 * stage.done // stage.total} % " if stage.total else ""
        return f"{share}{duration(time.time() - stage.started)} …"
    if stage.state in ("cached", "failed", "interrupted"):
        return stage.state
    return duration(stage.seconds)
