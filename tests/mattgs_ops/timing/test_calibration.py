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


def test_the_result_depends_on_every_part(monkeypatch: pytest.MonkeyPatch) -> None:
    table, places = calibration._inputs()
    first = calibration.workload(table, places)
    assert calibration.workload(table * np.float32(2), places) != first
    assert calibration.workload(table, places[1:]) != first
    monkeypatch.setattr(calibration, "ADDITIONS", calibration.ADDITIONS - 1)
    assert calibration.workload(table, places) != first


def test_it_adds_squares_and_what_it_gathers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "ADDITIONS", 4)
    table = np.array([0.5, 0.25, 8], np.float32)
    assert calibration.workload(table, np.array([0, 1, 1])) == 0 + 1 + 4 + 9 + 0.5 + 2 * 0.25


def test_each_piece_has_the_workload_right_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.accumulate([0.0, 1.0, 1.0, 0.5, 1.0, 0.25])  # two readings a workload
    monkeypatch.setattr(stopwatch, "seconds", lambda: next(clock))
    pairs = calibration.Pairs()  # the first workload warms up
    pairs.add(2.0)
    pairs.add(3.0)
    assert len(pairs) == 2
    assert pairs.seconds().tolist() == [[2.0, 3.0], [0.5, 0.25]]


def test_a_disturbance_of_most_measurements_is_forgotten() -> None:
    assert calibration.undisturbed([1.0, 1.0, 1.0, 7.0, 8.0, 9.0, 9.0, 9.0]) == 1.0


def test_the_engine_takes_no_part() -> None:
    tree = ast.parse(Path(calibration.__file__).read_text(encoding="utf-8"))
    named = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    named |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert named == {"numpy", "numpy.typing", "mattgs_ops.timing"}
