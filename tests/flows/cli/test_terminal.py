"""What a terminal, or a log, is told while a benchmark runs."""

import time
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from flows.cli import terminal
from flows.grid import stages
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.naming import slug
from tasks.stages.status import StatusFile


@pytest.mark.parametrize("is_terminal", [False, True])
def test_stages_that_will_never_run_count_no_more(
    is_terminal: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, "LINE_SECONDS", 0.0)
    captures = [{"name": "rover"}, {"name": "hexapod"}]
    config = {"name": "b", "captures": captures, "conditions": ["nobg-3dgs"]}
    planned = list(stages(BenchmarkConfig.model_validate(config)))
    text = StringIO()
    console = Console(file=text, width=100, force_terminal=is_terminal, color_system=None)
    with terminal.watch(tmp_path, len(planned), console):
        for kind, title in planned:
            StatusFile(tmp_path / f"{slug(title)}.json").plan(title, kind)
        for title in ("prepare hexapod", "prepare rover", "segment hexapod", "segment rover"):
            StatusFile(tmp_path / f"{slug(title)}.json").begin(title, title.split()[0])
        for name in ("prepare-hexapod", "prepare-rover"):
            StatusFile(tmp_path / f"{name}.json").end("done")
        StatusFile(tmp_path / "segment-rover.json").end("failed", "no object")
    told = text.getvalue()
    assert "✗ segment rover (no object)" in told
    never = 6  # of the rover: poses, masks that agree, truth, training, scores and speed
    assert f"3/{len(planned) - never}" in told
    assert f"3/{len(planned)}" not in told


def test_what_is_waited_for_is_told_when_it_takes_long_and_only_then() -> None:
    text = StringIO()
    console = Console(file=text, width=100)
    with terminal.told_when_slow(console, "the store", seconds=60):
        pass
    assert text.getvalue() == ""
    with terminal.told_when_slow(console, "the store", seconds=0):
        end = time.monotonic() + 30
        while not text.getvalue() and time.monotonic() < end:
            time.sleep(0.01)
    assert text.getvalue() == "! still waiting for the store\n"
