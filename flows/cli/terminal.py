"""What the person at the terminal sees while a benchmark runs.

Reads the status files (``tasks/stages/status.py``) a few times a second. On a terminal: one bar
for the whole benchmark and one for each running stage. Elsewhere (a log file, CI): a line when a
stage ends and a line about what is running every :data:`LINE_SECONDS`. Both say how many minutes
are left.
"""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import shorten

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)

from flows.cli.time_left import in_words, seconds_left
from flows.grid import without_lost
from mattgs_ops.progress import Progress as Report
from tasks.stages import status
from tasks.stages.status import Status

REFRESH_SECONDS = 0.5
LINE_SECONDS = 15.0
SLOW_SECONDS = 30.0  # services of our own are up by then, unless the machine is busy
MOST_LETTERS = 200  # of a library's error: the beginning says what, the end repeats addresses
MARKS = {"done": "✓", "cached": "=", "failed": "✗"}


@contextmanager
def watch(folder: Path, total: int, console: Console, lanes: int = 1) -> Iterator[None]:
    """Show what happens below the status folder until the block ends.

    ``total`` is the number of stages that the benchmark has when nothing fails; those that will
    never run count no more. ``lanes`` is how many run at a time.
    """
    kind = _Bars if console.is_terminal else _Lines
    view: _Bars | _Lines = kind(console, total, lanes)
    ended = threading.Event()

    def follow() -> None:
        while not ended.wait(REFRESH_SECONDS):
            view.update(status.read_all(folder))

    thread = threading.Thread(target=follow, daemon=True)
    with view:
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            view.update(status.read_all(folder))


@contextmanager
def told_when_slow(console: Console, what: str, seconds: float = SLOW_SECONDS) -> Iterator[None]:
    """Say that ``what`` is waited for when the block takes long: libraries try in silence."""
    text = f"! still waiting for {what}"
    timer = threading.Timer(seconds, console.print, (text,), {"style": "yellow", "markup": False})
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def kept_warnings() -> Iterator[list[str]]:
    """Keep the beginning of each warning that this project logs, as of a registry that fails.

    Prefect sets the libraries' terminals aside (``flows.services.embedded``), ours with them.
    """
    kept: list[str] = []

    class Keep(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            line = shorten(record.getMessage().partition("\n")[0], MOST_LETTERS, placeholder=" …")
            if line not in kept:
                kept.append(line)

    logger, handler = logging.getLogger("mattgs"), Keep(logging.WARNING)
    logger.addHandler(handler)
    try:
        yield kept
    finally:
        logger.removeHandler(handler)


def sentence(one: Status) -> str:
    """Say how a stage ended: ``✓ train rover nobg-ours seed 0 (2m 05s)``."""
    tail = {"cached": "already done", "failed": one.note}.get(one.state) or duration(one.seconds)
    return f"{MARKS[one.state]} {one.title} ({tail})"


def duration(seconds: float) -> str:
    """Write seconds as ``8s``, ``2m 05s`` or ``3h 07m``: ``humanize`` has no form that short."""
    total = round(seconds)
    if total < 60:
        return f"{total}s"
    if total < 3600:
        return f"{total // 60}m {total % 60:02d}s"
    return f"{total // 3600}h {total % 3600 // 60:02d}m"


def stage_times(stages: list[Status], seconds: float) -> str:
    """Say what each kind of stage took, one line each, and the wall time of it all."""
    stages = [stage for stage in stages if stage.state != "waiting"]
    lines = [f"{'stage':<10}{'runs':>6}{'cached':>8}{'failed':>8}{'time':>10}"]
    for name in dict.fromkeys(s.stage for s in stages):
        of_kind = [s for s in stages if s.stage == name]
        counts = [sum(s.state == state for s in of_kind) for state in ("done", "cached", "failed")]
        took = duration(sum(s.seconds for s in of_kind))
        lines.append(f"{name:<10}{counts[0]:>6}{counts[1]:>8}{counts[2]:>8}{took:>10}")
    lines.append(f"{'wall time':<32}{duration(seconds):>10}")
    return "\n".join(lines)


@contextmanager
def bar(title: str) -> Iterator[Report]:
    """Show one long operation; yields what it reports its progress to."""
    console = Console(stderr=True)
    with _progress_bar(console) as progress:
        task = progress.add_task(title, total=None, note="")

        def report(done: int, total: int, note: str) -> None:
            progress.update(task, completed=done, total=total or None, note=note)

        yield report


class _News:
    """Remembers which ends were printed already."""

    def __init__(self) -> None:
        self._printed: set[str] = set()

    def of(self, stages: list[Status]) -> list[Status]:
        ended = [s for s in stages if s.state in MARKS and s.title not in self._printed]
        self._printed |= {s.title for s in ended}
        return sorted(ended, key=lambda s: s.updated)


class _Lines:
    """Plain lines, few of them."""

    def __init__(self, console: Console, total: int, lanes: int) -> None:
        self._console = console
        self._total = total
        self._lanes = lanes
        self._news = _News()
        self._began = self._last = time.monotonic()

    def __enter__(self) -> None:
        """Nothing to set up."""

    def __exit__(self, *_: object) -> None:
        """Nothing to take down."""

    def update(self, stages: list[Status]) -> None:
        done = sum(s.state in MARKS for s in stages)
        to_run = without_lost(stages)
        count = f"{done:3d}/{self._total - len(stages) + len(to_run)}"
        for one in self._news.of(stages):
            self._print(f"{count} {sentence(one)}")
        if time.monotonic() - self._last >= LINE_SECONDS:
            running = [_running(s) for s in stages if s.state == "running"]
            if running:
                left = in_words(seconds_left(to_run, self._lanes, time.time()))
                self._print(f"{count} … {'; '.join([*running, left]).rstrip('; ')}")
            self._last = time.monotonic()

    def _print(self, text: str) -> None:
        since = duration(time.monotonic() - self._began)
        self._console.print(f"[{since:>7}] {text}", markup=False, highlight=False, soft_wrap=True)


def _running(one: Status) -> str:
    share = f" {100 * one.done // one.total}%" if one.total else ""
    return f"{one.title}{share}" + (f" ({one.note})" if one.note else "")


def _progress_bar(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}", style="dim"),
        console=console,
        transient=True,
    )


class _Bars:
    """Progress bars; ends of stages scroll by above them."""

    def __init__(self, console: Console, total: int, lanes: int) -> None:
        self._progress = _progress_bar(console)
        self._console = console
        self._lanes = lanes
        self._news = _News()
        self._total = total
        self._whole = self._progress.add_task("benchmark", total=total, note="")
        self._bars: dict[str, TaskID] = {}

    def __enter__(self) -> None:
        self._progress.start()

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def update(self, stages: list[Status]) -> None:
        for one in self._news.of(stages):
            style = "red" if one.state == "failed" else None
            self._console.print(sentence(one), style=style, markup=False, highlight=False)
        ended = sum(s.state in MARKS for s in stages)
        to_run = without_lost(stages)
        total = self._total - len(stages) + len(to_run)
        left = in_words(seconds_left(to_run, self._lanes, time.time()))
        self._progress.update(self._whole, completed=ended, total=total, note=left)
        running = {s.title: s for s in stages if s.state == "running"}
        for title in [t for t in self._bars if t not in running]:
            self._progress.remove_task(self._bars.pop(title))
        for title, one in running.items():
            if title not in self._bars:
                self._bars[title] = self._progress.add_task(title, total=None, note="")
            bar, steps = self._bars[title], one.total or None
            self._progress.update(bar, completed=one.done, total=steps, note=one.note)
