"""``mattgs status``: what each stage of a benchmark is doing, or how it ended."""

import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from flows.terminal import duration
from mattgs_ops.errors import InputError
from tasks import status
from tasks.status import Status

STYLES = {"done": "green", "cached": "green", "running": "yellow", "failed": "red"}


def show(out: Path, benchmark: str | None) -> None:
    """Print one table per benchmark; raises :class:`InputError` when there is nothing to show."""
    folder = out / "status"
    known = sorted(path.name for path in folder.glob("*") if path.is_dir())
    if not known or (benchmark is not None and benchmark not in known):
        asked = "any benchmark" if benchmark is None else f"benchmark {benchmark!r}"
        raise InputError(f"{out}: nothing known of {asked}; known: {', '.join(known) or 'none'}")
    console = Console()
    for name in known if benchmark is None else [benchmark]:
        table = Table(title=f"Benchmark {name}", title_justify="left")
        for heading in ("Stage", "State", "Done", "Time", "Note"):
            table.add_column(heading)
        for stage in status.read_all(folder / name):
            table.add_row(*_cells(stage), style=STYLES.get(stage.state))
        console.print(table)


def _cells(stage: Status) -> tuple[str, ...]:
    running = stage.state == "running"
    took = time.time() - stage.started if running else stage.seconds
    share = f"{stage.done}/{stage.total}" if stage.total else ""
    return stage.title, stage.state, share, duration(took), stage.note
