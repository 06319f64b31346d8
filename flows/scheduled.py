"""What runs on a schedule: a grid with the gate on it, the segmenter's training; Prefect flows.

``mattgs serve`` serves :data:`DEPLOYMENTS` from one process. ``prefect.yaml`` deploys the same to a
work pool; it is generated: ``python -m flows.scheduled > prefect.yaml``. Relative paths are taken
from the folder that the worker or server was started in.
"""

import logging
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast
from uuid import UUID, uuid4

import yaml
from prefect import Flow, flow
from prefect.artifacts import (
    create_link_artifact,
    create_markdown_artifact,
    create_progress_artifact,
    update_progress_artifact,
)
from prefect.runtime import flow_run

from flows.cli.arguments import DEFAULT_OUT
from mattgs_ops.errors import MattgsError
from mattgs_ops.progress import Progress, Throttle

PROGRESS_SECONDS = 5.0  # between two updates of a progress bar: each is an API call
WORK_POOL = "mattgs"  # prefect work-pool create --type process mattgs
PREFECT_FILE_HEAD = """\
# Written by `python -m flows.scheduled > prefect.yaml`; change flows/scheduled.py instead.
# Deployments for a process work pool (docs/operations.md). `mattgs serve` serves the same ones from
# one process. Paths are relative to the folder in which `prefect deploy` is run. Times are UTC.
"""


class GateError(MattgsError):
    """The gate did not pass."""


@flow(name="grid", flow_run_name="grid {name}", persist_result=False)
def grid(
    name: str,
    config: Path | None = None,
    iterations: int | None = None,
    resolution: int | None = None,
    seeds: tuple[int, ...] | None = None,
    conditions: tuple[str, ...] | None = None,
    remeasure: bool = True,
    out: Path = DEFAULT_OUT,
    run: str | None = None,
) -> None:
    """Run a benchmark as ``mattgs run`` does; ``config`` is a TOML file, the others override it.

    ``remeasure`` measures speed anew, also where no code has changed. ``run`` is what its record
    calls this run. Ends as failed when an experiment has failed.
    """
    from flows.cli.options import benchmark_config
    from flows.cli.run import run_benchmark

    given = {"iterations": iterations, "resolution": resolution, "seeds": seeds}
    merged = benchmark_config(config, {"name": name, "conditions": conditions, **given})
    complete = run_benchmark(merged, out.resolve(), run=run, remeasure=remeasure)
    if not complete:
        report = out.resolve() / "benchmarks" / name / "report.html"
        raise MattgsError(f"some experiments failed; report: {report}")


@flow(name="nightly", flow_run_name="nightly {name}", persist_result=False)
def nightly(
    name: str,
    baseline: str,
    config: Path | None = None,
    iterations: int | None = None,
    conditions: tuple[str, ...] | None = None,
    out: Path = DEFAULT_OUT,
) -> None:
    """Run a grid, speed measured anew, then judge what this very run wrote.

    ``baseline`` as for :func:`gate`. Where it is a file that is not there yet, it is made of this
    run, and said so. Ends as failed unless the gate passes, which a grid that broke off does not.
    """
    run = str(flow_run.id or uuid4())
    try:
        grid(name, config, iterations, conditions=conditions, out=out, run=run)
    except Exception as error:  # the gate says what came of it
        logging.getLogger("mattgs").warning("the grid %s did not end well: %s", name, error)
    file = Path(baseline)
    if file.suffix and not file.is_file():
        _first(name, file, out, run)
    else:
        gate(name, baseline, out=out, run=run)


def _first(name: str, file: Path, out: Path, run: str) -> None:
    """Make the baseline that the nights to come are judged against."""
    from flows import run_record
    from flows.gate import make_baseline, recorded

    wrong = run_record.problem(out.resolve() / "benchmarks" / name, run)
    failed = [] if wrong else [r for r in recorded(out.resolve(), name) if r["status"] == "failed"]
    if wrong or failed:
        told = wrong or f"{len(failed)} experiments failed"
        raise GateError(f"no baseline was made of {name}: {told}")
    make_baseline(out.resolve(), name, file)
    text = f"There was no baseline {file}: it was made of this run ({run}). Nothing was judged."
    create_markdown_artifact(text, key="gate", description=f"First baseline of {name}")


@flow(name="segmenter", flow_run_name="train segmenter", persist_result=False)
def segmenter(folder: Path, config: Path | None = None, out: Path = DEFAULT_OUT) -> None:
    """Train U²-Net as ``mattgs segment train`` does; an interrupted training goes on."""
    from flows.services import embedded
    from mattgs_ops.segment.network.train_config import SegmentTrainConfig, load_train_config
    from tasks.train_segmenter import train_segmenter

    settings = SegmentTrainConfig() if config is None else load_train_config(config)
    folder, out = folder.resolve(), out.resolve()
    tracking = embedded.tracking_uri(out)
    onnx = train_segmenter(settings, folder, tracking, out, progress=_progress_bar("segmenter"))
    create_link_artifact(
        onnx.as_uri(), key="segmenter", link_text=onnx.name, description="For `segment.model`"
    )


@flow(name="gate", flow_run_name="gate {benchmark}", persist_result=False)
def gate(benchmark: str, baseline: str, out: Path = DEFAULT_OUT, run: str | None = None) -> None:
    """Compare a recorded benchmark with a baseline; ends as failed unless the gate passes.

    ``run`` names the run whose rows these must be.
    """
    from flows.gate import judge

    text, code = judge(out.resolve(), benchmark, baseline, run=run)
    create_markdown_artifact(f"```\n{text}\n```", key="gate", description=f"Gate of {benchmark}")
    if code != 0:
        raise GateError(f"the gate of {benchmark} did not pass (exit code {code}):\n{text}")


def _progress_bar(key: str) -> Progress:
    """Show a long operation's progress in Prefect's interface."""
    bar = cast(UUID, create_progress_artifact(0.0, key=f"progress-{key}"))
    throttle = Throttle(PROGRESS_SECONDS)

    def update(done: int, total: int, note: str) -> None:
        if throttle.passes(done, total):
            text = f"step {done} of {total}: {note}"
            update_progress_artifact(bar, 100.0 * done / total, description=text)

    return update


@dataclass(frozen=True)
class Deployment:
    """A flow, when it runs (cron, UTC; None: on request), and with what parameters."""

    flow: Flow[..., None]
    name: str
    cron: str | None
    description: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.flow.name}/{self.name}"


DEPLOYMENTS = (
    Deployment(
        nightly,
        "quick",
        "0 1 * * *",
        "The bundled captures at the quick setting, then the gate on this run's numbers",
        {"name": "nightly", "baseline": "baseline.json"},
    ),
    Deployment(
        grid,
        "weekly",
        "0 8 * * 6",
        "The paper's 30,000 iterations",
        {"name": "weekly", "iterations": 30_000, "resolution": 640},
    ),
    Deployment(
        gate,
        "on-request",
        None,
        "A recorded benchmark against a baseline, on request",
        {"benchmark": "nightly", "baseline": "baseline.json"},
    ),
    Deployment(
        segmenter,
        "training",
        None,
        "U²-Net anew, on request",
        {"folder": "mattgs-out/segmenter"},
    ),
)


def prefect_file() -> str:
    """Return the text of ``prefect.yaml``: :data:`DEPLOYMENTS` for a process work pool."""
    entries = []
    for one in DEPLOYMENTS:
        entry: dict[str, Any] = {
            "name": one.name,
            "entrypoint": f"flows/scheduled.py:{one.flow.fn.__name__}",
            "description": one.description,
        }
        if one.cron is not None:
            entry["schedules"] = [{"cron": one.cron}]
        entry["parameters"] = dict(one.parameters)
        entry["work_pool"] = {"name": WORK_POOL, "work_queue_name": "default"}
        entry["concurrency_limit"] = 1
        entries.append(entry)
    content = {"name": "mattgs-bench", "deployments": entries}
    text: str = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    return PREFECT_FILE_HEAD + text


def serve_all(names: frozenset[str], out: Path) -> None:
    """Serve the deployments called ``FLOW/NAME`` in ``names``, or all, until Ctrl-C."""
    from prefect import serve
    from prefect.deployments.runner import RunnerDeployment

    deployments = [
        RunnerDeployment.from_flow(
            one.flow,
            one.name,
            cron=one.cron,
            parameters={**one.parameters, "out": str(out)},
            description=one.description,
        )
        for one in DEPLOYMENTS
        if not names or str(one) in names
    ]
    # one at a time: two grids at once would only slow each other down
    serve(*deployments, limit=1, print_starting_message=False)


if __name__ == "__main__":
    sys.stdout.write(prefect_file())
