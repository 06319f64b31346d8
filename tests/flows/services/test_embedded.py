"""What a run starts beside itself."""

import os

import pytest

from flows.services.embedded import worker_count
from mattgs_ops.config import RunConfig


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        (RunConfig(), 6),
        (RunConfig(threads=2), 3),
        (RunConfig(threads=4), 1),
        (RunConfig(threads=8), 1),
        (RunConfig(workers=9), 9),
    ],
)
def test_one_thread_per_core_that_this_process_may_use_unless_told_otherwise(
    run: RunConfig, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(6)))
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert worker_count(run) == expected
