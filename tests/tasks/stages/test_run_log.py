"""A stage's log in its run's log: line by line, never half a line, not without end."""

import json
import logging
from pathlib import Path

import pytest

from tasks.stages import run_log
from tasks.stages.run_log import RunLog, _Follower
from tasks.stages.status import StatusFile


@pytest.fixture
def follower(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> _Follower:
    caplog.set_level(logging.INFO)
    (tmp_path / "stage.log").write_text("of an attempt before\n")
    return _Follower(logging.getLogger("run"), tmp_path / "stage.log", tmp_path / "status.json")


def append(follower: _Follower, text: str) -> None:
    with follower._log.open("ab") as file:
        file.write(text.encode())
    follower._copy()


def test_new_lines_are_copied_and_a_line_is_waited_for_to_its_end(
    follower: _Follower, caplog: pytest.LogCaptureFixture
) -> None:
    append(follower, "--- 2026-11-22 train\nfirst\n\nsec")
    assert caplog.messages == ["first"]
    append(follower, "ond\r10 %\r20 %\nlast")
    assert caplog.messages == ["first", "second", "10 %", "20 %"]
    follower.over.set()
    follower.run()
    assert caplog.messages[-1] == "last"


def test_a_stage_that_prints_too_much_is_cut_and_the_file_named(
    follower: _Follower, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_log, "MOST_LINES", 2)
    monkeypatch.setattr(run_log, "MOST_LETTERS", 3)
    append(follower, "12345\nb\nc\nd\n")
    assert caplog.messages == ["123", "b", f"further lines are in {follower._log} only"]


def test_progress_is_written_once_until_it_changes(
    follower: _Follower, caplog: pytest.LogCaptureFixture
) -> None:
    status = StatusFile(follower._status)
    status.begin("train", "train")
    status.progress(3, 10, "21.5 dB")
    follower._progress()
    follower._progress()
    assert json.loads(follower._status.read_text())["done"] == 3
    assert caplog.messages == ["3 of 10: 21.5 dB"]


def test_outside_a_run_nothing_is_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    log = RunLog()
    log.info("to nobody")
    with log.following(tmp_path / "none.log", tmp_path / "none.json"):
        pass
    assert not caplog.records
