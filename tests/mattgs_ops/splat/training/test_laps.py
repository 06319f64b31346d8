"""Laps are of equal steps, hold what was measured, and forget moments that were not fair."""

from collections.abc import Iterator

import numpy as np
import pytest

from mattgs_ops.splat.training import laps
from mattgs_ops.splat.training.laps import (
    FIRST_SECONDS,
    LAPS,
    MOST_PIECES,
    PIECE_WORKLOADS,
    Laps,
)

WORKLOAD = 0.002
PIECE = PIECE_WORKLOADS * WORKLOAD


class FakePairs:
    """Pairs whose workloads take what the test says, else the same time each."""

    workloads: Iterator[float] | None = None
    made = 0

    def __init__(self) -> None:
        self.pairs: list[tuple[float, float]] = []

    def add(self, seconds: float) -> float:
        FakePairs.made += 1
        given = WORKLOAD if FakePairs.workloads is None else next(FakePairs.workloads)
        self.pairs.append((seconds, given))
        return given

    def seconds(self) -> np.ndarray:
        return np.array(self.pairs, dtype=np.float64).reshape(-1, 2).T


@pytest.fixture(autouse=True)
def _quick_workload(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(laps, "Pairs", FakePairs)
    monkeypatch.setattr(FakePairs, "made", 0)


def test_every_step_counts_once() -> None:
    found = Laps(100)
    for step in range(1, 101):
        found.add(step, 0.01 * step)
    assert len(found.rows) == LAPS
    assert sum(row["value"] for row in found.rows) == pytest.approx(0.01 * 5050)
    assert found.rows[0]["value"] == pytest.approx(0.01 * 78)


def test_the_fastest_workload_is_of_all_laps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakePairs, "workloads", iter([3 * WORKLOAD, WORKLOAD, 2 * WORKLOAD] * LAPS))
    found = Laps(3 * LAPS)
    assert found.fastest_workload() == np.inf
    for step in range(1, 3 * LAPS + 1):
        found.add(step, 2 * PIECE)
    assert found.fastest_workload() == WORKLOAD


def test_steady_steps_give_the_workload_itself() -> None:
    found = Laps(80)
    for step in range(1, 81):
        found.add(step, 0.004)
    for row in found.rows:
        assert row == {"value": pytest.approx(0.04), "calibration": pytest.approx(WORKLOAD)}


def test_a_moment_that_hit_the_workload_alone_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken = [WORKLOAD, 9 * WORKLOAD, WORKLOAD, WORKLOAD, WORKLOAD] * LAPS
    monkeypatch.setattr(FakePairs, "workloads", iter(taken))
    found = Laps(5 * LAPS)
    for step in range(1, 5 * LAPS + 1):
        found.add(step, 2 * PIECE)
    assert [row["calibration"] for row in found.rows] == pytest.approx([WORKLOAD] * LAPS)


def test_workloads_take_a_tenth_of_the_time_whatever_one_takes_here(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    slow = 3 * WORKLOAD
    monkeypatch.setattr(FakePairs, "workloads", iter([slow] * 1000))
    found, step_seconds, steps = Laps(800), FIRST_SECONDS, 800
    for step in range(1, steps + 1):
        found.add(step, step_seconds)
    least, most = (steps * step_seconds / (PIECE_WORKLOADS * slow) + k for k in (0, 2 * LAPS))
    assert least <= FakePairs.made <= most


def test_short_steps_share_a_workload_and_long_trainings_do_not_pay_for_it() -> None:
    short = Laps(8)
    for step in range(1, 9):
        short.add(step, 0.1 * PIECE)
    assert FakePairs.made == LAPS
    FakePairs.made = 0
    long = Laps(100_000)
    for step in range(1, 100_001):
        long.add(step, 2 * PIECE)
    assert FakePairs.made <= LAPS * (MOST_PIECES + 1)


@pytest.mark.parametrize("iterations", [1, 3, 7, 9])
def test_short_trainings_have_fewer_or_uneven_laps(iterations: int) -> None:
    found = Laps(iterations)
    for step in range(1, iterations + 1):
        found.add(step, 1.0)
    assert len(found.rows) == min(iterations, LAPS)
