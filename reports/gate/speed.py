"""Speed that two runs can share: every value relative to a fixed workload of its own process.

From a row, the first that is there: ``repeats``, measurements in turns with the workload
(``{"time": [{"value": 2.1, "calibration": 0.051}, …]}``, laps of a training for example); the
metric ``fps_calibrated`` or ``time_calibrated``; the plain metric with the workload's seconds, a
number or ``{"seconds": …}``, in the provenance or, for rates, in the metric ``calibration``.

The workload takes off how busy or how fast a machine is at the moment; it does not make two kinds
of processor alike, so that speeds of different machines are not compared at all.
"""

import math
from collections.abc import Mapping
from typing import Any

from reports.rows.schema import Row

RATES = {"fps"}  # per second: a slower machine has less; all others are seconds: it has more
MACHINE = ("cpu", "cpu_kind", "cores", "threads", "workload")  # of the provenance
ROUNDING = ("cpu", "cpu_kind")  # of it, what decides how numbers are rounded


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
        repeats = [{"value": row["metrics"].get(metric), "calibration": _workload(row, metric)}]
    values = {}
    for index, repeat in enumerate(repeats):
        value, workload = repeat.get("value"), seconds(repeat.get("calibration"))
        if not isinstance(value, int | float) or not value > 0 or workload is None:
            return {}
        values[str(index)] = value * workload if metric in RATES else value / workload
    return values


def noise(row: Row, metric: str) -> float:
    """Return the relative standard error that the row states for a calibrated value, else 0."""
    stated = row["metrics"].get(f"{metric}_noise")
    return float(stated) if isinstance(stated, int | float) and math.isfinite(stated) else 0.0


def machine_of(row: Row, metric: str) -> Mapping[str, Any]:
    """Return the part of a row's provenance that says where a speed was measured.

    Rendering is measured apart from the training, and a training may have been timed again; rows
    that do not say so were measured where they were trained.
    """
    origin = row.get("provenance") or {}
    machine = origin.get("measured" if metric in RATES else "timed") or origin
    return dict(machine)


def other_machine(candidate: Row, baseline: Row, metric: str) -> str:
    """Say how the machines of a speed in two rows differ; empty when they are of one kind."""
    ours, theirs = (machine_of(row, metric) for row in (candidate, baseline))
    if not ours.get("cpu") or not theirs.get("cpu"):
        return "the machine is not known"
    unlike = [name for name in MACHINE if ours.get(name) != theirs.get(name)]
    differences = (
        f"{name}: baseline {theirs.get(name)}, candidate {ours.get(name)}" for name in unlike
    )
    return f"another machine ({'; '.join(differences)})" if unlike else ""


def rounds_otherwise(candidate: Row, baseline: Row) -> bool:
    """Whether two rows come from processors that may round differently; unknown ones may."""
    ours, theirs = (row.get("provenance") or {} for row in (candidate, baseline))
    return not ours.get("cpu") or any(ours.get(name) != theirs.get(name) for name in ROUNDING)


def _workload(row: Row, metric: str) -> Any:
    ours = (row.get("provenance") or {}).get("calibration")
    return ours or (row["metrics"].get("calibration") if metric in RATES else None)


def seconds(calibration: Any) -> float | None:
    """Read a calibration in either form; None where there is none."""
    if isinstance(calibration, Mapping):
        calibration = calibration.get("seconds")
    if isinstance(calibration, int | float) and calibration > 0:
        return float(calibration)
    return None
