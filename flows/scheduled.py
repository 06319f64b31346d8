"""What runs on a schedule: a grid, the segmenter's training, the gate; each as a Prefect flow.

``prefect.yaml`` deploys them to a work pool, ``mattgs serve`` serves the same list from one
process. Relative paths are taken from the folder that the worker or server was started in.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast
from uuid import UUID

from prefect import Flow, flow
from prefect.artifacts import (
    create_link_artifact,
    create_markdown_artifact,
    create_progress_artifact,
    update_progress_artifact,
)

from mattgs_ops.errors import MattgsError
from mattgs_ops.progress import Progress

DEFAULT_OUT = Path("mattgs-out")
PROGRESS_SECONDS = 5.0  # an update is an API call


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
    out: Path = DEFAULT_OUT,
) -> None:
    """Run a benchmark as ``mattgs run`` does; ``config`` is a TOML file, the others override it.

    Ends as failed when an experiment has failed.
    """
    from flows.cli.options import benchmark_config
    from flows.cli.run import run_benchmark

    given = {"iterations": iterations, "resolution": resolution, "seeds": seeds}
    merged = benchmark_config(config, {"name": name, "conditions": conditions, **given})
    complete = run_benchmark(merged, out.resolve())
    if not complete:
        report = out.resolve() / "benchmarks" / name / "report.html"
        raise MattgsError(f"some experiments failed; report: {report}")


@flow(name="segmenter", flow_run_name="train segmenter", persist_result=False)
def segmenter(folder: Path, config: Path | None = None, out: Path = DEFAULT_OUT) -> None:
    """Train U²-Net as ``mattgs segment train`` does; an interrupted training goes on."""
    from flows.services import embedded
    from mattgs_ops.segment.network.train_config import SegmentTrainConfig, load_train_config
    from tasks.train_segmenter import train_segmenter

    settings = SegmentTrainConfig() if config is None else load_train_config(config)
    folder, out = folder.resolve(), out.resolve()
    tracking = embedded.tracking_uri(out)
    onnx = train_segmenter(settings, folder, tracking, out, progress=_shown("segmenter"))
    create_link_artifact(
        onnx.as_uri(), key="segmenter", link_text=onnx.name, description="For `segment.model`"
    )


@flow(name="gate", flow_run_name="gate {benchmark}", persist_result=False)
def gate(benchmark: str, baseline: str, out: Path = DEFAULT_OUT) -> None:
    """Compare a recorded benchmark with a baseline; ends as failed unless the gate passes."""
    from flows.gate import judge

    text, code = judge(out.resolve(), benchmark, baseline)
    create_markdown_artifact(f"```\n{text}\n```", key="gate", description=f"Gate of {benchmark}")
    if code != 0:
        raise GateError(f"the gate of {benchmark} did not pass (exit code {code}):\n{text}")


def _shown(key: str) -> Progress:
    """Show a long operation's progress in Prefect's interface."""
    made = cast(UUID, create_progress_artifact(0.0, key=f"progress-{key}"))
    last = time.monotonic()

    def show(done: int, total: int, note: str) -> None:
        nonlocal last
        if done == total or time.monotonic() - last >= PROGRESS_SECONDS:
            last = time.monotonic()
            text = f"step {done} of {total}: {note}"
            update_progress_artifact(made, 100.0 * done / total, description=text)

    return show


@dataclass(frozen=True)
class Schedule:
    """One deployment: a flow, when it runs (cron, UTC; None: when asked for), and with what."""

    flow: Flow[..., None]
    name: str
    cron: str | None
    description: str
    parameters: Mapping[str, Any] = field(default_factory=dict)


SCHEDULES = (
    Schedule(
        grid,
        "nightly",
        "0 1 * * *",
        "The bundled captures at the quick setting",
        {"name": "nightly"},
    ),
    Schedule(
        gate,
        "nightly",
        "0 7 * * *",
        "Last night's numbers against the baseline",
        {"benchmark": "nightly", "baseline": "baseline.json"},
    ),
    Schedule(
        grid,
        "weekly",
        "0 8 * * 6",
        "The paper's 30,000 iterations",
        {"name": "weekly", "iterations": 30_000, "resolution": 640},
    ),
    Schedule(
        segmenter,
        "training",
        None,
        "U²-Net anew, when asked for",
        {"folder": "mattgs-out/segmenter"},
    ),
)


def serve_all(names: frozenset[str], out: Path) -> None:
    """Serve the schedules called ``FLOW/NAME`` in ``names``, or all, until Ctrl-C."""
    from prefect import serve
    from prefect.deployments.runner import RunnerDeployment

    deployments = [
        RunnerDeployment.from_flow(
            s.flow,
            s.name,
            cron=s.cron,
            parameters={**s.parameters, "out": str(out)},
            description=s.description,
        )
        for s in SCHEDULES
        if not names or f"{s.flow.name}/{s.name}" in names
    ]
    # one at a time: two grids at once would only slow each other down
    serve(*deployments, limit=1, print_starting_message=False)
