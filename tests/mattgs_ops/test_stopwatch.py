"""The stopwatch counts work and sleep, not the queue for a processor."""

from pathlib import Path

import pytest

from mattgs_ops import stopwatch


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
    wall, queue = iter([10.0, 13.0]), iter([1.0, 1.75])
    monkeypatch.setattr(stopwatch.time, "perf_counter", lambda: next(wall))
    monkeypatch.setattr(stopwatch, "queued", lambda: next(queue))
    assert -stopwatch.seconds() + stopwatch.seconds() == pytest.approx(3 - 0.75)
