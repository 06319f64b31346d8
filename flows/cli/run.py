"""One benchmark from the command line: captures checked, services up, flow, tables, report."""

import time
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from queue import Empty, SimpleQueue

from rich.console import Console

from flows import run_record
from flows.cli import terminal
from flows.cli.arguments import EXIT_FAILED
from flows.grid import stages
from flows.services import dask_cluster, embedded, registries
from flows.services.background import Background
from flows.services.embedded import Services
from mattgs_ops.capture.photos import mark_output
from mattgs_ops.config import BenchmarkConfig, CaptureConfig
from mattgs_ops.errors import InputError, MattgsError
from mattgs_ops.naming import slug
from mattgs_ops.store.cleaning import in_use
from mattgs_ops.store.remote import RemoteStore
from mattgs_ops.store.store import Store
from tasks.prepare import prepare
from tasks.stages import status
from tasks.stages.stage import Place, own_version

MOST_WARNINGS = 5  # of those that a library's failure makes, one for each experiment, say


def run_benchmark(
    config: BenchmarkConfig,
    out: Path,
    *,
    run: str | None = None,
    remeasure: bool = False,
    died: int = EXIT_FAILED,
) -> bool:
    """Run a benchmark and print its tables; return whether every experiment finished.

    ``run`` is what its record is to call it; with ``remeasure`` speed is measured anew where it is
    known. Should our own Prefect server end meanwhile, the process exits with ``died``. Captures
    are prepared before any other stage runs, while services start. Raises :class:`InputError` that
    lists all that is wrong with them when none of them can be used.
    """
    mark_output(out)
    folder = out / "benchmarks" / config.name
    record = run_record.begin(folder, run, remeasure=remeasure)
    kept = config.run.model_copy(update={"sitting": record.sitting})
    try:
        complete = _run(config.model_copy(update={"run": kept}), out, died, record)
    except BaseException as error:  # Ctrl-C too: its rows are not there
        reason = _reason(error)
        run_record.end(folder, record, reason)
        if isinstance(error, SystemExit):
            raise MattgsError(f"{reason}; the same command goes on from here") from error
        raise
    run_record.end(folder, record)
    return complete


def _reason(error: BaseException) -> str:
    """Say in words why a run broke off."""
    if isinstance(error, KeyboardInterrupt):
        return "it was interrupted"
    if isinstance(error, SystemExit):
        if isinstance(error.__context__, BrokenPipeError):  # Rich ends the program
            return "what read its output has ended"
        return f"a library ended it with exit code {error.code}"
    return str(error) or type(error).__name__


def _run(config: BenchmarkConfig, out: Path, died: int, record: run_record.RunRecord) -> bool:
    """Start what is needed, run the flow, print its tables."""
    began = time.monotonic()
    console = Console(soft_wrap=True)
    out.mkdir(parents=True, exist_ok=True)
    embedded.enter(out)
    place = Place(out, config.name, config.run, len(config.captures), own_version())
    if config.run.store is not None:
        with terminal.told_when_slow(console, f"--store {config.run.store}"):
            RemoteStore(config.run.store).check()
    others = ", ".join(str(process) for process, _ in record.beside)
    if others:
        text = f"another run of {config.name} is at work in {out} (process {others}); "
        text += "rows and report will be those of the run that ends last"
        console.print(f"! {text}", style="yellow", markup=False, highlight=False)
    count = _plan(place, config, alone=not others)
    if not any(one.path is None or one.path.exists() for one in config.captures):
        _prepare_all(place, config)  # says so; services that start would hold that up for long
    with (
        in_use(Store(place.store)),
        embedded.Starting(out, config.run, died) as starting,
        terminal.kept_warnings() as kept,
    ):
        with terminal.watch(place.status, count, console, dask_cluster.worker_count(config.run)):
            with Background(_import_flow) as flow:  # while preparation waits for its processes
                _prepare_all(place, config)
            flow.finish()
            with terminal.told_when_slow(console, f"services, {registries.shown(out)} among them"):
                services = starting.ready()
            registries.note(out)
            console.print(str(services), markup=False, highlight=False)
            report, complete = _run_flow(config, out, services)
        _print_end(place, report, console, time.monotonic() - began, kept)
    return complete


def _plan(place: Place, config: BenchmarkConfig, *, alone: bool = True) -> int:
    """Write the status of every stage of the grid, none begun; return how many have one.

    Where this run is not ``alone``, all that another has written stays until this one gets there.
    """
    planned = {place.status / f"{slug(stage[1])}.json": stage for stage in stages(config)}
    there = set(place.status.glob("*.json"))
    if alone:
        for old in there - planned.keys():
            old.unlink(missing_ok=True)
        there = set()
    for path in planned.keys() - there:
        kind, title = planned[path]
        status.StatusFile(path).plan(title, kind)
    return len(planned.keys() | there)


def _import_flow() -> None:
    """Import what the flow needs: two seconds of a core."""
    for name in ("prefect_dask", "flows.benchmark"):
        import_module(name)


def _prepare_all(place: Place, config: BenchmarkConfig) -> None:
    """Prepare every capture, as many at a time as there are workers.

    Raises one :class:`InputError` when none can be used. One that cannot, among others, is printed
    at once as a failed stage; the flow makes rows that say why.
    """
    waiting: SimpleQueue[CaptureConfig] = SimpleQueue()
    for capture in config.captures:
        waiting.put(capture)
    problems: dict[str, str] = {}  # by capture

    def work() -> None:
        with suppress(Empty):
            while True:
                capture = waiting.get_nowait()
                if problem := _prepare(place, capture, config):
                    problems[capture.name] = problem

    count = min(dask_cluster.worker_count(config.run), len(config.captures))
    for thread in [Background(work) for _ in range(count)]:
        thread.finish()
    if len(problems) == len(config.captures):
        raise InputError("\n".join(problems[capture.name] for capture in config.captures))


def _prepare(place: Place, capture: CaptureConfig, config: BenchmarkConfig) -> str:
    """Prepare one capture; return what is wrong with it, nothing where it can be used."""
    try:
        prepare(place, capture, config)
    except MattgsError as error:  # a crash or a timeout, too
        title = f"prepare {capture.name}"  # which may not have begun
        file = status.StatusFile(place.status / f"{slug(title)}.json")
        file.end_elsewhere(title, "prepare", "failed", 0.0, str(error))
        return str(error)
    return ""


def _run_flow(config: BenchmarkConfig, out: Path, services: Services) -> tuple[Path, bool]:
    """Run the flow; return its report and whether all experiments finished."""
    from prefect_dask import DaskTaskRunner

    from flows.benchmark import ExperimentsFailedError, benchmark
    from flows.prefect_ui import notifications

    runner = DaskTaskRunner(address=services.dask_scheduler)
    notifications.check(config.run.notify)
    hooks = notifications.failure_hook(config.run.notify)
    try:
        run = benchmark.with_options(task_runner=runner, on_failure=hooks, on_crashed=hooks)
        report = run(config, out, services.tracking_uri, services.dask_dashboard)
    except ExperimentsFailedError as failed:
        return failed.report, False
    return report, True


def _print_end(
    place: Place, report: Path, console: Console, seconds: float, kept: Sequence[str] = ()
) -> None:
    from reports.rows.doubts import warnings
    from reports.rows.schema import read_rows
    from reports.tables.tables import terminal as tables

    console.print()
    rows = read_rows(report.parent / "rows.json")
    console.print(tables(rows), markup=False, highlight=False)
    left = len(kept) - MOST_WARNINGS
    more = [f"{left} more such warnings"] if left > 0 else []
    if any(row.get("run_id", "") is None for row in rows):
        more.append("MLflow lacks some of these experiments; the same command again records them")
    for line in [*warnings(rows), *kept[:MOST_WARNINGS], *more]:
        console.print(f"! {line}", style="yellow", markup=False, highlight=False)
    stages = status.read_all(place.status)
    console.print(terminal.stage_times(stages, seconds), markup=False, highlight=False)
    console.print(f"Runs: mattgs ui --out {place.out}", markup=False, highlight=False)
    console.print(f"Report: {report.resolve()}", markup=False, highlight=False)
