"""What MLflow holds of a benchmark over time: runs with their numbers and the gate's verdicts.

Runs are read by search, a page at a time; none of their files is opened.
"""

import json
import logging
from collections.abc import Mapping
from typing import Any

from mattgs_ops.errors import InputError
from tasks.registry import project, runs
from tasks.registry.content.values import CURVE, SYSTEM

GATE_TAG = "mattgs.gate"  # what the gate said last of a run's cell, as JSON
ENDED = {"FINISHED": "finished", "FAILED": "failed"}
NUMBERS, WORDS = ("seed", "iterations", "resolution"), ("capture", "background", "method")
ORIGIN = (
    "git",
    "code_version",
    "config_digest",
    "inputs",
    "protocol",
    "timed_on",
    "measured_on",
)
MILLISECONDS = 1000


def runs_of(tracking_uri: str, benchmark: str) -> list[dict[str, Any]]:
    """Return a benchmark's runs that ended, oldest first; ``reports.history.series`` reads them.

    Raises :class:`InputError` that names the known benchmarks when there is none of this name.
    """
    client, experiment = _experiment(tracking_uri, benchmark)
    ended = [run for run in runs.pages(client, experiment) if run.info.status in ENDED]
    return [_as_entry(run) for run in reversed(ended)]


def _experiment(tracking_uri: str, benchmark: str) -> tuple[Any, str]:
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    experiment = client.get_experiment_by_name(project.experiment_name(benchmark))
    if experiment is None:
        known = ", ".join(runs.benchmarks(tracking_uri)) or "none yet"
        raise InputError(f"no benchmark is called {benchmark!r}; known: {known}")
    return client, str(experiment.experiment_id)


def _as_entry(run: Any) -> dict[str, Any]:
    tags = run.data.tags
    numbers = {name: int(tags[name]) for name in NUMBERS}
    words = {name: tags[name] for name in WORDS}
    metrics = {k: v for k, v in run.data.metrics.items() if not k.startswith((CURVE, SYSTEM))}
    return {
        **numbers,
        **words,
        "budget": int(tags.get("budget") or 0),
        **{name: tags.get(name, "") for name in ORIGIN},
        "run_id": str(run.info.run_id),
        "when": run.info.start_time / MILLISECONDS,
        "status": ENDED[run.info.status],
        "metrics": metrics,
        "gate": json.loads(tags[GATE_TAG]) if GATE_TAG in tags else None,
    }


def record_verdicts(
    tracking_uri: str, baseline: str, verdicts: Mapping[str, Mapping[str, str]]
) -> None:
    """Tag each run with what the gate said of it; never raises.

    ``verdicts``: by run id, the verdict of each metric. What an earlier gate said is replaced.
    """
    try:
        from mlflow.tracking import MlflowClient

        client: Any = MlflowClient(tracking_uri=tracking_uri)
        for run_id, said in verdicts.items():
            text = json.dumps({"baseline": baseline, "verdicts": dict(said)}, sort_keys=True)
            client.set_tag(run_id, GATE_TAG, text)
    except Exception as error:  # whatever MLflow, its database or its server raise
        logging.getLogger("mattgs").warning("verdicts were not logged to MLflow: %s", error)
