"""``mattgs status``: per experiment, what each of its stages is doing, or how it ended."""

import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from flows import run_record
from flows.cli.terminal import MARKS, duration
from mattgs_ops.errors import InputError
from tasks.stages import status
from tasks.stages.status import State, Status

# An experiment is what the first of these says that holds for one of its stages.
FIRST: tuple[State, ...] = ("failed", "interrupted", "running")
STYLES: dict[State, str] = {
    "done": "green",
    "cached": "green",
    "running": "yellow",
    "interrupted": "red",
    "failed": "red",
}
OF_A_CAPTURE = ("prepare", "segment", "sfm", "agree")
OF_AN_EXPERIMENT = ("train", "evaluate")
TRUTH = "truth"  # once per capture and background
SPEED = "measure"  # once per capture, last
NARROWEST = 100  # columns, where no terminal says how wide it is


@dataclass(frozen=True)
class Progress:
    """One experiment: its name, and the status of its stages by their kind.

    ``over``: the run has ended, so that what waits will not begin.
    """

    name: str
    stages: dict[str, Status]
    over: bool = False

    @property
    def state(self) -> State:
        """State of the experiment, from those of its stages."""
        states = [stage.state for stage in self.stages.values()]
        for state in FIRST:
            if state in states:
                return state
        if "waiting" in states:
            if self.over:
                return "interrupted"
            return "waiting" if states.count("waiting") == len(states) else "running"
        return "cached" if set(states) == {"cached"} else "done"


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
        over = run_record.over(out / "benchmarks" / name)
        _print(name, experiments(status.read_all(folder / name), over=over), console)


def experiments(stages: list[Status], *, over: bool = False) -> list[Progress]:
    """Sort stages to the experiments that need them; those of a capture count for each.

    ``over`` as in :class:`Progress`.
    """
    by_title = {stage.title: stage for stage in stages}
    result = []
    for stage in sorted(stages, key=lambda stage: stage.title):
        if stage.stage != "train":
            continue
        name = stage.title.removeprefix("train ")
        capture = name.partition(" ")[0]
        titles = {kind: f"{kind} {capture}" for kind in (*OF_A_CAPTURE, SPEED)}
        titles |= {kind: f"{kind} {name}" for kind in OF_AN_EXPERIMENT}
        background = name.partition(" ")[2].partition("-")[0]
        titles[TRUTH] = f"{TRUTH} {capture} {background}"
        order = (*OF_A_CAPTURE, OF_AN_EXPERIMENT[0], TRUTH, *OF_AN_EXPERIMENT[1:], SPEED)
        stages_of_one = {kind: by_title[titles[kind]] for kind in order if titles[kind] in by_title}
        result.append(Progress(name, stages_of_one, over))
    return result


def _print(name: str, progress: list[Progress], console: Console) -> None:
    counts = Counter(one.state for one in progress)
    states = ", ".join(f"{counts[state]} {state}" for state in sorted(counts))
    noun = "experiment" if len(progress) == 1 else "experiments"
    console.print(f"Benchmark {name}: {len(progress)} {noun}: {states}", highlight=False)
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


def _kinds(progress: list[Progress], kinds: Iterable[str]) -> list[str]:
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


def _add_row(table: Table, one: Progress, *words: str, style: str | None = None) -> None:
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
