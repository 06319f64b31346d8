"""The fixed workload is fixed: the same numbers each time, and work that is not skipped."""

import ast
import itertools
from pathlib import Path

import numpy as np
import pytest

from mattgs_ops.timing import calibration, stopwatch


def test_the_workload_is_the_same_each_time_and_takes_time() -> None:
    inputs = calibration._inputs()
    first = calibration.workload(*inputs)
    assert first == calibration.workload(*calibration._inputs())
    assert calibration.calibrate(repeats=2) > 1e-4


def test_the_result_depends_on_every_part() -> None:
    cache, table, places, swept = calibration._inputs(sweeping=True)
    first = calibration.workload(cache, table, places, swept)
    assert calibration.workload(cache + np.float32(1), table, places, swept) != first
    assert calibration.workload(cache, table * np.float32(2), places, swept) != first
    assert calibration.workload(cache, table, places, swept * np.float32(2)) != first


def test_compositing_follows_the_formula() -> None:
    """With the table and what is swept at zero: colour adds up to 1 minus the light left."""
    cache = np.array([0.3, 0.7], np.float32)
    nothing = np.zeros(4, np.float32)
    light = np.ones(2)
    for step in range(calibration.CACHE_ROUNDS):
        light *= 1 - 0.02 * np.exp(-(0.5 + step / calibration.CACHE_ROUNDS) * cache)
    found = calibration.workload(cache, nothing, np.arange(4), np.zeros((2, 4), np.float32))
    assert found == pytest.approx(float(np.mean(1 - light)), abs=1e-4)


def test_a_piece_is_told_in_the_workload_right_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.accumulate([0.0, 1.0, 1.0, 0.5, 1.0, 0.25])  # two readings a workload
    monkeypatch.setattr(stopwatch, "seconds", lambda: next(clock))
    pairs = calibration.Pairs(sweeping=False)  # the first workload warms up
    pairs.add(2.0)
    pairs.add(3.0)
    assert len(pairs) == 2
    assert pairs.ratios().tolist() == [2.0 / 0.5, 3.0 / 0.25]
    assert pairs.fastest() == 0.25


def test_the_engine_takes_no_part() -> None:
    tree = ast.parse(Path(calibration.__file__).read_text(encoding="utf-8"))
    named = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    named |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert named == {"numpy", "numpy.typing", "mattgs_ops.timing"}
