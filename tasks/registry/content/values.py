"""What a run holds: a row as metrics, parameters and tables, in the batches that MLflow takes."""

import json
import math
import time
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

Row = dict[str, Any]
VIEWS_FILE = "per_view.json"
BATCH_METRICS, BATCH_PARAMETERS = 1000, 100  # MLflow's limits for one call of log_batch
CURVE, SYSTEM = "curve_", "system/"  # MLflow's interface shows the latter on a page of their own
NOT_MEASURED = ("step", "time")  # of a point: when it was, not what
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

    numbers = {**_of_stages(row), **(row.get("metrics") or {})}.items()
    return [Metric(key, float(value), now, 0) for key, value in numbers if _is_number(value)]


def _of_stages(row: Row) -> dict[str, Any]:
    """Return numbers that a row keeps apart from its metrics.

    How many views have a pose, how good the masks are, and the training's time in workloads of the
    same process (the median over its laps, times their number).
    """
    numbers = {
        "registered": (row.get("registration") or {}).get("registered"),
        "mean_iou": (row.get("masks") or {}).get("mean_iou"),
    }
    laps = (row.get("repeats") or {}).get("time") or []
    if laps and all(lap.get("calibration") for lap in laps):
        ratios = [lap["value"] / lap["calibration"] for lap in laps]
        numbers["time_calibrated"] = median(ratios) * len(ratios)
    return numbers


def new_points(
    client: Any, run_id: str, points: Sequence[Mapping[str, float]], prefix: str
) -> Sequence[Mapping[str, float]]:
    """Return the points of a series that the run does not have yet; they come by their ``step``."""
    if not points:
        return []
    name = next(key for key in points[0] if key not in NOT_MEASURED)
    logged = client.get_metric_history(run_id, f"{prefix}{name}")
    last = max((metric.step for metric in logged), default=-1)
    return [point for point in points if point["step"] > last]


def point_metrics(
    points: Sequence[Mapping[str, float]], prefix: str, now: int | None = None
) -> list[Any]:
    """Return a series as metrics by step, their names with a prefix.

    Each is dated ``now`` in milliseconds, or by its point's ``time`` in seconds.
    """
    from mlflow.entities import Metric

    return [
        Metric(
            f"{prefix}{key}",
            float(value),
            round(1000 * point["time"]) if now is None else now,
            int(point["step"]),
        )
        for point in points
        for key, value in point.items()
        if key not in NOT_MEASURED and _is_number(value)
    ]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def log_metrics(client: Any, run_id: str, metrics: list[Any]) -> None:
    """Log metrics in batches."""
    for start in range(0, len(metrics), BATCH_METRICS):
        client.log_batch(run_id, metrics=metrics[start : start + BATCH_METRICS])


def log_changed(client: Any, run: Any, row: Row) -> None:
    """Log the metrics whose values the run does not show already."""
    logged = run.data.metrics
    new = row_metrics(row, time.time_ns() // 1_000_000)
    log_metrics(client, run.info.run_id, [m for m in new if logged.get(m.key) != m.value])


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
