"""Rows of a small grid, before and after a change, for the gate."""

import math
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from reports.gate import output
from reports.gate.findings import GateReport, Verdict
from reports.rows.schema import Row

SCHEMA = Path(output.__file__).with_name("schema.json")


Rows = list[Row]


@pytest.fixture
def old(make_grid: Callable[..., Rows]) -> Rows:
    return make_grid()


def jittered(rows: Rows, decibels: float = 0.02, seed: int = 1) -> Rows:
    """Another run of the same code on another machine: a little different everywhere."""
    rng = np.random.default_rng(seed)
    out = deepcopy(rows)
    for row in out:
        for view in row["per_view"]:
            for name in ("psnr", "mask_psnr"):
                view[name] += rng.normal(0, decibels)
        for name in ("time", "fps"):
            row["metrics"][name] *= math.exp(rng.normal(0, 0.01))
    return out


def changed(
    rows: Rows, change: Callable[[Row], None], only: Callable[[Row], bool] = lambda _: True
) -> Rows:
    out = jittered(rows)
    for row in out:
        if only(row):
            change(row)
    return out


def found(report: GateReport, verdict: Verdict) -> set[tuple[str, str]]:
    return {(f.cell, f.metric) for f in report.findings if f.verdict == verdict}


def shift_views(row: Row, **shifts: float) -> None:
    for view in row["per_view"]:
        for name, shift in shifts.items():
            view[name] += shift


def poison(row: Row) -> None:
    row["metrics"]["psnr"] = math.nan
