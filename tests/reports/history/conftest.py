"""Runs as the registry returns them, with levels that are planted."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

Run = dict[str, Any]
HOUR = 3600.0


def make_run(place: int, metrics: Mapping[str, float], **changes: Any) -> Run:
    """Return the run of the commit at ``place`` in time."""
    return {
        "capture": "rover",
        "background": "nobg",
        "method": "ours",
        "seed": 0,
        "iterations": 100,
        "resolution": 64,
        "git": f"{place:08x}{'0' * 32}",
        "code_version": f"code{place}",
        "config_digest": "one",
        "inputs": "{}",
        "protocol": "2",
        "timed_on": "desk",
        "measured_on": "desk",
        "run_id": f"run{place}",
        "when": 1_760_000_000.0 + place * HOUR,
        "status": "finished",
        "metrics": dict(metrics),
        "gate": None,
    } | changes


@pytest.fixture
def history_of() -> Callable[..., list[Run]]:
    """Return a function that makes a run per value of a metric, one commit each."""

    def made(values: Sequence[float], metric: str = "psnr", **changes: Any) -> list[Run]:
        return [make_run(i, {metric: value}, **changes) for i, value in enumerate(values)]

    return made
