"""What runs on a schedule: a grid with the gate on it, the segmenter's training; Prefect flows.

``mattgs serve`` serves :data:`DEPLOYMENTS` from one process, or those of a file ``prefect.yaml``
(``flows/schedule_file.py``). The project's own deploys the same to a work pool; it is generated:
``python -m flows.scheduled [IMAGE] > prefect.yaml``. Relative paths are taken from the folder that
the worker or server was started in.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, cast
from uuid import UUID, uuid4

import yaml
from prefect import Flow, flow
from prefect.artifacts import (
    create_markdown_artifact,
    create_progress_artifact,
    update_progress_artifact,
)
from prefect.deployments.runner import RunnerDeployment
from prefect.logging import get_run_logger
from prefect.runtime import flow_run
from prefect.schedules import Cron

from flows.forms import GateForm, GridForm, JudgeForm, NightlyForm, SegmenterForm
from flows.prefect_ui.notifications import parameters_hook
from mattgs_ops.errors import MattgsError
from mattgs_ops.frozen import Frozen
from mattgs_ops.progress import Progress, Throttle

PROGRESS_SECONDS = 5.0  # between two updates of a progress bar: each is an API call
P = ParamSpec("P")
WORK_POOL = "mattgs"  # prefect work-pool create --type process mattgs
IMAGE_FOLDER = "/data"  # of Dockerfile, where stages write
PREFECT_FILE_HEAD = """\
# Written by `python -m flows.scheduled > prefect.yaml`; change flows/scheduled.py instead.
# Deployments for a work pool (docs/prefect.md). `mattgs serve` serves the same ones from one
# process. Paths are relative to the folder in which `prefect deploy` is run. Times are UTC.
"""


class GateError(MattgsError):
    """The gate did not pass."""


def scheduled(name: str, run_name: str) -> Callable[[Callable[P, None]], Flow[P, None]]:
    """Make a flow that sends its failure, with its parameters, where the user wants it."""
    hooks: list[Any] = [parameters_hook]
    return flow(
        name=name,
        flow_run_name=run_name,
        persist_result=False,
        on_failure=hooks,
        on_crashed=hooks,
    )


@scheduled("grid", "grid {settings.name}")
def grid(settings: GridForm, run: str | None = None) -> None:
    """Run a benchmark as ``mattgs run`` does. Ends as failed when an experiment has failed.

    ``run`` is what its record calls this run.
    """
    from flows.cli.options import benchmark_config
    from flows.cli.run import run_benchmark

    merged = benchmark_config(settings.config, settings.options())
    out = settings.out.resolve()
    if not run_benchmark(merged, out, run=run, remeasure=settings.remeasure):
        report = out / "benchmarks" / settings.name / "report.html"
        raise MattgsError(f"some experiments failed; report: {report}")


@scheduled("nightly", "nightly {settings.name}")
def nightly(settings: NightlyForm) -> None:
    """Run a grid, then judge what this very run wrote.

    Where the baseline is a file that is not there yet, it is made of this run, and the artifact
    says so. Ends as failed unless the gate passes, which a grid that broke off does not.
    """
    run = str(flow_run.id or uuid4())
    name, out, judged = settings.name, settings.out, settings.gate
    try:
        grid(GridForm(**settings.model_dump(exclude={"gate"})), run=run)
    except Exception as error:  # the gate says what came of it
        get_run_logger().warning("the grid %s did not end well: %s", name, error)
    file = Path(judged.baseline)
    if file.suffix and not file.is_file():
        _first(name, file, out, run)
    else:
        gate(JudgeForm(benchmark=name, out=out, **judged.model_dump()), run=run)


def _first(name: str, file: Path, out: Path, run: str) -> None:
    """Make the baseline that the nights to come are judged against."""
    from flows import run_record
    from flows.gate import make_baseline, recorded

    wrong = run_record.problem(out.resolve() / "benchmarks" / name, run)
    failed = [] if wrong else [r for r in recorded(out.resolve(), name) if r["status"] == "failed"]
    if wrong or failed:
        reason = wrong or f"{len(failed)} experiments failed"
        raise GateError(f"no baseline was made of {name}: {reason}")
    make_baseline(out.resolve(), name, file)
    text = f"There was no baseline {file}: it was made of this run ({run}). Nothing was judged."
    create_markdown_artifact(text, key="gate", description=f"First baseline of {name}")


@scheduled("segmenter", "train segmenter")
def segmenter(settings: SegmenterForm) -> None:
    """Train U²-Net as ``mattgs segment train`` does; an interrupted training goes on."""
    from flows.services import embedded, registries
    from mattgs_ops.segment.network.train_config import SegmentTrainConfig, load_train_config
    from tasks.train_segmenter import train_segmenter

    config = settings.config
    training = SegmentTrainConfig() if config is None else load_train_config(config)
    folder, out = settings.folder.resolve(), settings.out.resolve()
    embedded.enter(out)
    tracking = registries.current(out)
    onnx = train_segmenter(training, folder, tracking, out, progress=_progress_bar("segmenter"))
    text = f"The network for `segment.model`: `{onnx}`"
    create_markdown_artifact(text, key="segmenter", description=onnx.name)


@scheduled("gate", "gate {settings.benchmark}")
def gate(settings: JudgeForm, run: str | None = None) -> None:
    """Compare a recorded benchmark with a baseline; ends as failed unless the gate passes.

    ``run`` names the run whose rows these must be.
    """
    from flows.gate import judge

    name, out = settings.benchmark, settings.out.resolve()
    text, code = judge(
        out, name, settings.baseline, doubt=settings.doubt, must_see=settings.must_see, run=run
    )
    create_markdown_artifact(f"```\n{text}\n```", key="gate", description=f"Gate of {name}")
    if code != 0:
        raise GateError(f"the gate of {name} did not pass (exit code {code}):\n{text}")


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
    """A flow, when it runs (cron; None: on request), and what its form is filled with.

    Its schedule is in UTC unless ``timezone`` names another, and rests unless ``active``; a paused
    deployment rests as a whole.
    """

    flow: Flow[..., None]
    name: str
    cron: str | None
    description: str
    settings: Frozen
    timezone: str | None = None
    active: bool = True
    paused: bool = False

    def __str__(self) -> str:
        return f"{self.flow.name}/{self.name}"

    @property
    def when(self) -> str:
        """Say when it runs, and whether it rests, as ``mattgs serve`` prints it."""
        if self.cron is None:
            return "on request"
        zone = f" {self.timezone}" if self.timezone else ""
        return f"{self.cron}{zone}{'' if self.active and not self.paused else ', paused'}"

    def parameters(self, **others: object) -> dict[str, Any]:
        """Return the flow's parameters as JSON values: what is set here, and ``others``."""
        values = self.settings.model_copy(update=others)
        return {"settings": values.model_dump(mode="json", exclude_unset=True)}


DEPLOYMENTS = (
    Deployment(
        nightly,
        "quick",
        "0 1 * * *",
        "The bundled captures at the quick setting, then the gate on this run's numbers",
        NightlyForm(name="nightly", gate=GateForm(baseline="baseline.json")),
    ),
    Deployment(
        grid,
        "weekly",
        "0 8 * * 6",
        "The paper's 30,000 iterations",
        GridForm(name="weekly", iterations=30_000, resolution=640),
    ),
    Deployment(
        gate,
        "on-request",
        None,
        "A recorded benchmark against a baseline, on request",
        JudgeForm(benchmark="nightly", baseline="baseline.json"),
    ),
    Deployment(
        segmenter,
        "training",
        None,
        "U²-Net anew, on request",
        SegmenterForm(),
    ),
)


def prefect_file(image: str | None = None) -> str:
    """Return the text of ``prefect.yaml``: :data:`DEPLOYMENTS` for a process work pool.

    With ``image``, a container image that has this package, for a docker or kubernetes one.
    """
    entries = []
    for one in DEPLOYMENTS:
        function = one.flow.fn.__name__
        entry: dict[str, Any] = {
            "name": one.name,
            "entrypoint": f"flows/scheduled.py:{function}",
            "description": one.description,
        }
        if one.cron is not None:
            entry["schedules"] = [{"cron": one.cron}]
        entry["parameters"] = one.parameters()
        entry["work_pool"] = {"name": WORK_POOL, "work_queue_name": "default"}
        entry["concurrency_limit"] = 1
        if image is not None:  # which has the package installed, and no file flows/scheduled.py
            entry["entrypoint"] = f"flows.scheduled.{function}"
            entry["work_pool"]["job_variables"] = {"image": image}
        entries.append(entry)
    content: dict[str, Any] = {"name": "mattgs-bench"}
    if image is not None:
        step = "prefect.deployments.steps.set_working_directory"
        content["pull"] = [{step: {"directory": IMAGE_FOLDER}}]
    content["deployments"] = entries
    text: str = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    return PREFECT_FILE_HEAD + text


def runner_deployments(
    names: frozenset[str], out: Path, listed: Sequence[Deployment] = DEPLOYMENTS
) -> list[RunnerDeployment]:
    """Return the deployments called ``FLOW/NAME`` in ``names``, or all, for one serving process."""
    return [
        RunnerDeployment.from_flow(
            one.flow,
            one.name,
            schedules=[Cron(one.cron, one.timezone, active=one.active)] if one.cron else None,
            paused=one.paused,
            parameters=one.parameters(out=out),
            description=one.description,
        )
        for one in listed
        if not names or str(one) in names
    ]


def serve_all(names: frozenset[str], out: Path, listed: Sequence[Deployment] = DEPLOYMENTS) -> None:
    """Serve the deployments called ``FLOW/NAME`` in ``names``, or all, until Ctrl-C."""
    from prefect import serve

    # one at a time: two grids at once would only slow each other down
    serve(*runner_deployments(names, out, listed), limit=1, print_starting_message=False)


if __name__ == "__main__":
    sys.stdout.write(prefect_file(*sys.argv[1:2]))
