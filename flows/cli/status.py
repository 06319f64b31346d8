"""``mattgs status``: per experiment, what each of its stages is doing, or how it ended."""

import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

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
    """One experiment: its name, and the status of its stages by their kind."""

    name: str
    stages: dict[str, Status]

    @property
    def state(self) -> State:
        """State of the experiment, from those of its stages."""
        states = [stage.state for stage in self.stages.values()]
        for state in FIRST:
            if state in states:
                return state
        if "waiting" in states:
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
        _print(name, experiments(status.read_all(folder / name)), console)


def experiments(stages: list[Status]) -> list[Progress]:
    """Sort stages to the experiments that need them; those of a capture count for each."""
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
        result.append(Progress(name, stages_of_one))
    return result


def _print(name: str, progress: list[Progress], console: Console) -> None:
    counts = Counter(one.state for one in progress)
    states = ", ".join(f"{counts[state]} {state}" for state in sorted(counts))
    title = f"Benchmark {name}: {len(progress)} experiments: {states}"
    kinds = list(dict.fromkeys(kind for one in progress for kind in one.stages))
    table = Table(title=title, title_justify="left")
    for heading in ("Experiment", "State", *kinds):
        table.add_column(heading)
    for one in progress:
        cells = [_cell(one.stages.get(kind)) for kind in kinds]
        table.add_row(one.name, one.state, *cells, style=STYLES.get(one.state))
    console.print(table)
    stages = [stage for one in progress for stage in one.stages.values()]
    notes = {s.title: s.note for s in stages if s.state == "failed"}
    for stage, note in notes.items():
        console.print(f"{MARKS['failed']} {stage}: {note}", style="red", markup=False)
    ended = {s.title: s for s in stages if s.note}
    for title, one_stage in ended.items():
        if one_stage.state in ("done", "cached"):
            console.print(f"! {title}: {one_stage.note}", style="yellow", markup=False)


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
