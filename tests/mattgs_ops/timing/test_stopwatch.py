"""The stopwatch counts work and sleep, not the queue for a processor."""

import time
from itertools import pairwise
from pathlib import Path

import pytest

from mattgs_ops.timing import stopwatch


def test_the_second_number_is_the_wait_in_nanoseconds(tmp_path: Path) -> None:
    file = tmp_path / "schedstat"
    file.write_text("604172 2500000000 3\n")
    assert stopwatch.queued(file) == pytest.approx(2.5)


@pytest.mark.parametrize("text", ["", "7", "a b c"])
def test_a_kernel_that_does_not_tell_leaves_the_wall_clock(tmp_path: Path, text: str) -> None:
    file = tmp_path / "schedstat"
    file.write_text(text)
    assert stopwatch.queued(file) == stopwatch.queued(tmp_path / "absent") == 0


def test_waiting_for_a_processor_is_taken_off_and_the_rest_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wall, queue = iter([10.0, 13.0]), iter([1.0, 1.0, 1.75, 1.75])
    monkeypatch.setattr(time, "perf_counter", lambda: next(wall))
    monkeypatch.setattr(stopwatch, "queued", lambda: next(queue))
    assert -stopwatch.seconds() + stopwatch.seconds() == pytest.approx(3 - 0.75)


def test_a_wait_between_the_two_readings_asks_for_new_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else the wait would be taken off a time that does not hold it, and work could be negative."""
    wall, queue = iter([10.0, 10.5]), iter([1.0, 1.4, 1.4])
    monkeypatch.setattr(time, "perf_counter", lambda: next(wall))
    monkeypatch.setattr(stopwatch, "queued", lambda: next(queue))
    assert stopwatch.seconds() == pytest.approx(10.5 - 1.4)


def test_work_is_never_negative() -> None:
    readings = [stopwatch.seconds() for _ in range(300)]
    assert all(after >= before for before, after in pairwise(readings))
