"""Laps are of equal steps and hold what was measured."""

import pytest

from mattgs_ops.splat import laps
from mattgs_ops.splat.laps import LAPS, Laps


@pytest.fixture(autouse=True)
def _quick_workload(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(laps, "calibrate", lambda repeats: 0.5 * repeats)


def test_every_step_counts_once() -> None:
    found = Laps(100)
    for step in range(1, 101):
        found.add(step, 0.01 * step)
    assert len(found.rows) == LAPS
    assert sum(row["value"] for row in found.rows) == pytest.approx(0.01 * 5050)
    assert found.rows[0] == {"value": pytest.approx(0.01 * 78), "calibration": 0.5}


@pytest.mark.parametrize("iterations", [1, 3, 7, 9])
def test_short_trainings_have_fewer_or_uneven_laps(iterations: int) -> None:
    found = Laps(iterations)
    for step in range(1, iterations + 1):
        found.add(step, 1.0)
    assert len(found.rows) == min(iterations, LAPS)
