"""What a run holds: a row as metrics, parameters and tables, in the batches that MLflow takes."""

import json
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

Row = dict[str, Any]
VIEWS_FILE = "per_view.json"
BATCH_METRICS, BATCH_PARAMETERS = 1000, 100  # MLflow's limits for one call of log_batch


PARAMETER_LENGTH = 6000  # MLflow's limit for a value


def flatten(nested: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Flatten nested mappings: ``{"train": {"lr": 1}}`` → ``{"train.lr": "1"}``."""
    out: dict[str, str] = {}
    for key, value in nested.items():
        if isinstance(value, Mapping):
            out |= flatten(value, f"{prefix}{key}.")
        else:
            out[f"{prefix}{key}"] = str(value)[:PARAMETER_LENGTH]
    return out


def row_metrics(row: Row, now: int) -> list[Any]:
    """Return a row's numbers as MLflow's metrics, dated ``now`` in milliseconds."""
    from mlflow.entities import Metric

    found = (row.get("metrics") or {}).items()
    return [Metric(key, float(value), now, 0) for key, value in found if _is_number(value)]


def curve_metrics(curve: Sequence[Mapping[str, float]], now: int) -> list[Any]:
    """Return a training curve as metrics ``curve_*`` by step."""
    from mlflow.entities import Metric

    return [
        Metric(f"curve_{key}", float(value), now, int(point["step"]))
        for point in curve
        for key, value in point.items()
        if key != "step" and _is_number(value)
    ]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def log_metrics(client: Any, run_id: str, metrics: list[Any]) -> None:
    """Log metrics in batches."""
    for start in range(0, len(metrics), BATCH_METRICS):
        client.log_batch(run_id, metrics=metrics[start : start + BATCH_METRICS])


def log_changed(client: Any, run_id: str, row: Row) -> None:
    """Log the metrics whose values the run does not show already."""
    known = client.get_run(run_id).data.metrics
    new = row_metrics(row, time.time_ns() // 1_000_000)
    log_metrics(client, run_id, [m for m in new if known.get(m.key) != m.value])


def log_tags(client: Any, run_id: str, tags: Mapping[str, str]) -> None:
    """Set tags of a run."""
    from mlflow.entities import RunTag

    client.log_batch(run_id, tags=[RunTag(key, value) for key, value in tags.items()])


def log_parameters(client: Any, run_id: str, parameters: Mapping[str, Any]) -> None:
    """Log nested parameters, flattened with dots."""
    from mlflow.entities import Param

    flat = [Param(key, value) for key, value in flatten(parameters).items()]
    for start in range(0, len(flat), BATCH_PARAMETERS):
        client.log_batch(run_id, params=flat[start : start + BATCH_PARAMETERS])


def log_views(client: Any, run_id: str, views: Sequence[Mapping[str, Any]]) -> None:
    """Store per-view scores as a table that MLflow's interface shows as one."""
    if not views:
        return
    columns = list(dict.fromkeys(key for view in views for key in view))
    data = [[view.get(column) for column in columns] for view in views]
    client.log_dict(run_id, {"columns": columns, "data": data}, VIEWS_FILE)
    tables = json.dumps([{"path": VIEWS_FILE, "type": "table"}])
    client.set_tag(run_id, "mlflow.loggedArtifacts", tables)
