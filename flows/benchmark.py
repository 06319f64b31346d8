"""The benchmark flow: captures → masks → masked SfM → masks that agree → training → scores → rows.

One chain of tasks per capture, fanned out into one per experiment. Chains are
independent: when a task fails, what depends on it does not run, its experiments become rows that
say why, and all others continue. Speed is measured last, when nothing else runs.
"""

import sys
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

import dask
from prefect import flow
from prefect.futures import PrefectFuture

from flows.grid import cells
from flows.prefect_ui.artifacts import ProgressBar, publish_dashboard, publish_results
from flows.services.dask_cluster import needed
from flows.services.report_server import report_address
from mattgs_ops.config import BenchmarkConfig, CaptureConfig, Condition
from mattgs_ops.errors import MattgsError
from mattgs_ops.naming import slug
from tasks import prefect_tasks as run
from tasks.measure import Speed, with_speed
from tasks.registry.live_curves import Expected, following
from tasks.registry.record import (
    about_run,
    close,
    close_orphans,
    promoted,
    record,
    record_summary,
)
from tasks.row import Outcome, Row, make_row, running_row, settings
from tasks.stages.cores import own_cores
from tasks.stages.run_log import RunLog
from tasks.stages.stage import Artifact, Cell, Place, own_version
from tasks.stages.status import StatusFile
from tasks.train import training_title

Future = PrefectFuture[Artifact]


class ExperimentsFailedError(MattgsError):
    """Some experiments failed; all rows and the report are written."""

    def __init__(self, failed: int, total: int, report: Path) -> None:
        super().__init__(failed, total, report)
        self.report = report

    def __str__(self) -> str:
        failed, total, report = self.args
        return f"{failed} of {total} experiments failed; report: {report}"


@dataclass(frozen=True)
class Chain:
    """The tasks that one experiment depends on, first to last; ``broken`` when none could start."""

    cell: Cell
    prepared: Artifact | None = None
    futures: tuple[tuple[str, Future], ...] = ()
    broken: str | None = None


@flow(name="benchmark", flow_run_name="{config.name}", persist_result=False)
def benchmark(
    config: BenchmarkConfig, out: Path, tracking_uri: str, dashboard: str | None = None
) -> Path:
    """Run every experiment of the grid; write its rows and its report below ``out``.

    ``dashboard`` is the address of Dask's, where there is one. Returns the report's path. Raises
    :class:`ExperimentsFailedError`, after everything was written, when an experiment has failed.
    """
    place = Place(out, config.name, config.run, len(config.captures), own_version())
    close_orphans(tracking_uri, config.name)
    if dashboard is not None:
        publish_dashboard(config.name, dashboard)
    chains = [chain for capture in config.captures for chain in _submit(place, capture, config)]
    # takes seconds to import (Matplotlib), while the workers have begun
    from reports.page.build import build

    run_log = RunLog()
    outcomes: list[Outcome] = []
    recorded: list[Row] = []
    progress_bar = ProgressBar(config.name, len(chains))
    with following(place, tracking_uri, _expected(place, config, chains)):
        for chain in chains:
            outcomes.append(_wait(place, chain))
            row = make_row(place, config, outcomes[-1])
            _warn(place, row)
            made = outcomes[-1].artifacts
            about = about_run(place, config, chain.cell, command(), made)
            configured = settings(config, chain.cell)
            recorded.append(record(place, tracking_uri, row, configured, made, about))
            failed_so_far = sum(outcome.reason is not None for outcome in outcomes)
            progress_bar.update(len(outcomes), failed_so_far)
            run_log.info(f"{len(outcomes)} of {len(chains)}: {chain.cell}: {_ended(recorded[-1])}")
    outcomes, speeds = _measure(place, outcomes, config)
    rows = []
    for outcome, before in zip(outcomes, recorded, strict=True):
        row = with_speed(make_row(place, config, outcome), speeds.get(outcome.cell))
        about = about_run(place, config, outcome.cell, command(), outcome.artifacts)
        rows.append(close(tracking_uri, row, before, about))
    path = build(
        rows,
        out / "benchmarks" / config.name,
        title=f"Benchmark {config.name}",
        artifacts_root=place.store,
        baselines=promoted(tracking_uri, config.name),
        processes=own_cores(),
    )
    recorded_at = record_summary(place, tracking_uri, config.name, rows, path)
    publish_results(config.name, rows, path, report_address(path) or recorded_at)
    failed = [row for row in rows if row["status"] == "failed"]
    if failed:
        raise ExperimentsFailedError(len(failed), len(rows), path)
    return path


def _submit(place: Place, capture: CaptureConfig, config: BenchmarkConfig) -> list[Chain]:
    """Submit all tasks of one capture; preparation runs here, where the photos are."""
    mine = list(cells(config, capture.name))
    try:
        prepared = run.configured(run.prepare, capture.name, config)(place, capture, config)
    except Exception as error:  # whatever it is, it is these experiments' alone
        return [Chain(cell, broken=str(error)) for cell in mine]
    name = capture.name
    segment, sfm = (run.configured(stage, name, config) for stage in (run.segment, run.sfm))
    masks = segment.submit(place, name, prepared, config.segment)
    solved = sfm.submit(place, name, prepared, masks, config.sfm)
    before: tuple[tuple[str, Future], ...] = (("segment", masks), ("sfm", solved))
    scene = solved
    if config.segment.refine == "votes":
        scene = run.configured(run.agree, name, config).submit(place, name, prepared, solved)
        before = (*before, ("agree", scene))
    chains = []
    for cell in mine:
        train, evaluate = (run.configured(s, cell, config) for s in (run.train, run.evaluate))
        with takes(config):
            splats = train.submit(place, cell, scene, config)
        scores = evaluate.submit(place, cell, scene, splats, config)
        futures = (*before, ("train", splats), ("evaluate", scores))
        chains.append(Chain(cell, prepared, futures))
    return chains


def _ended(row: Row) -> str:
    """Say how an experiment ended, for the run's log."""
    if row["status"] == "failed":
        return f"failed: {row['reason']}"
    return f"PSNR {row['metrics']['psnr']:.2f} dB"


def takes(config: BenchmarkConfig) -> AbstractContextManager[object]:
    """Have Dask give what is submitted in this context a training's resources."""
    annotated: AbstractContextManager[object] = dask.annotate(resources=needed(config.run))
    return annotated


def _expected(place: Place, config: BenchmarkConfig, chains: list[Chain]) -> dict[str, Expected]:
    """Say which run each training belongs to, by the title of its stage."""
    return {
        training_title(chain.cell): Expected(
            running_row(place, config, chain.cell, chain.prepared),
            settings(config, chain.cell),
            about_run(place, config, chain.cell, command()),
        )
        for chain in chains
        if chain.prepared is not None
    }


def _wait(place: Place, chain: Chain) -> Outcome:
    """Wait for one experiment; the first of its tasks that failed says why."""
    if chain.prepared is None:
        return Outcome(chain.cell, reason=chain.broken)
    outcome = Outcome(chain.cell, {"prepare": chain.prepared})
    for name, future in chain.futures:
        owner = chain.cell if name in ("train", "evaluate") else chain.cell.capture
        status_file = StatusFile(place.status / f"{slug(f'{name} {owner}')}.json")
        try:
            # raises too when Dask lost the worker, which a plain wait() would pass over in silence
            made = future.result()
            place.folder(made)  # brings it here from where it was made
            outcome.artifacts[name] = made
            if name == "evaluate":  # which has seen to it, perhaps on another machine
                _end_truth(place, chain.cell)
            status_file.end_elsewhere(
                f"{name} {owner}", name, "cached" if made.cached else "done", made.seconds
            )
        except Exception as error:
            reason = str(error) or type(error).__name__
            status_file.end_elsewhere(f"{name} {owner}", name, "failed", 0.0, reason)
            return replace(outcome, reason=reason)
    return outcome


def _end_truth(place: Place, cell: Cell) -> None:
    """Say that what the cell's renders were compared with is there."""
    title = f"truth {cell.capture} {Condition.parse(cell.condition).background}"
    StatusFile(place.status / f"{slug(title)}.json").end_elsewhere(title, "truth", "done", 0.0)


def command() -> str:
    """Name what runs this benchmark, as MLflow's column *Source* shows it."""
    program, *words = sys.argv
    if Path(program).stem != "mattgs":
        return "Prefect flow benchmark"
    return " ".join(["mattgs", *(word for word in words[:1] if not word.startswith("-"))])


def _warn(place: Place, row: Row) -> None:
    """Leave a row's warnings with the stage that made its masks, for `mattgs status`."""
    stages = [stage for stage in ("segment", "agree") if stage in row["seconds"]]
    if row["warnings"] and stages:
        title = slug(" ".join([stages[-1], row["capture"]]))
        status_file = StatusFile(place.status / f"{title}.json")
        status_file.warn("; ".join(one["text"] for one in row["warnings"]))


def _measure(
    place: Place, outcomes: list[Outcome], config: BenchmarkConfig
) -> tuple[list[Outcome], dict[Cell, Speed]]:
    """Measure the speed of everything that finished, each capture alone on a worker's machine.

    Returns the outcomes, those whose speed could not be measured as failed, and the speeds.
    """
    speeds: dict[Cell, Speed] = {}
    after = list(outcomes)
    measuring: list[tuple[list[int], PrefectFuture[dict[Cell, Speed]]]] = []
    for capture in config.captures:
        mine = [
            i
            for i, outcome in enumerate(outcomes)
            if outcome.cell.capture == capture.name and outcome.reason is None
        ]
        if mine:
            finished = [outcomes[i] for i in mine]
            task = run.configured(run.measure, capture.name, config)
            with takes(config):  # it trains, too
                measuring.append((mine, task.submit(place, capture.name, finished, config)))
    for mine, future in measuring:
        try:
            speeds |= future.result()
        except Exception as error:  # whatever it is, it is this capture's alone
            for i in mine:
                after[i] = replace(outcomes[i], reason=f"speed was not measured: {error}")
    return after, speeds
