"""Speed that two machines can share: every value relative to a fixed workload of its own process.

From a row, the first that is there: ``repeats``, measurements interleaved with the workload
(``{"fps": [{"value": 61.2, "calibration": 0.051}, …]}``); the metric ``fps_calibrated`` or
``time_calibrated``; the plain metric with the metric ``calibration``, or with the provenance's
(seconds, a number or ``{"seconds": …}``).
"""

from collections.abc import Mapping
from typing import Any

from reports.rows import Row

RATES = {"fps"}  # per second: a slower machine has less; all others are seconds: it has more


def calibrated(row: Row, metric: str) -> dict[str, float]:
    """Return calibrated values by repeat; empty where value or calibration is missing.

    Seconds are divided by the workload's seconds, rates multiplied by them; both are then numbers
    without a unit that a uniformly slower machine does not change.
    """
    repeats = (row.get("repeats") or {}).get(metric)
    if not repeats:
        ready = row["metrics"].get(f"{metric}_calibrated")
        if ready:
            return {"0": float(ready)}
        repeats = [{"value": row["metrics"].get(metric), "calibration": _workload(row)}]
    found = {}
    for index, repeat in enumerate(repeats):
        value, workload = repeat.get("value"), seconds(repeat.get("calibration"))
        if not value or not workload:
            return {}
        found[str(index)] = value * workload if metric in RATES else value / workload
    return found


def _workload(row: Row) -> Any:
    return row["metrics"].get("calibration") or (row.get("provenance") or {}).get("calibration")


def seconds(calibration: Any) -> float | None:
    """Read a calibration in either form; None where there is none."""
    if isinstance(calibration, Mapping):
        calibration = calibration.get("seconds")
    if isinstance(calibration, int | float) and calibration > 0:
        return float(calibration)
    return None
