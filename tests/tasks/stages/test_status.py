"""Status files: what a stage does, and what is learnt of stages that ran where nobody sees."""

from pathlib import Path

import pytest

from tasks.stages import status
from tasks.stages.status import StatusFile, read, read_all


def test_a_stage_is_followed_from_start_to_end(tmp_path: Path) -> None:
    file = StatusFile(tmp_path / "train.json")
    assert read(file.path) is None
    file.begin("train a", "train")
    file.progress(3, 10, "24 dB")
    running = read(file.path)
    assert running is not None
    assert (running.state, running.done, running.total, running.note) == ("running", 3, 10, "24 dB")
    file.end("done")
    (ended,) = read_all(tmp_path)
    assert (ended.state, ended.done, ended.note) == ("done", 10, "")


def test_progress_that_falls_back_began_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(status, "THROTTLE_SECONDS", 0.0)
    file = StatusFile(tmp_path / "sfm.json")
    file.begin("sfm a", "sfm")
    seen = []
    for done, total in [(3, 10), (9, 10), (1, 20), (5, 20)]:
        file.progress(done, total, "")
        now = read(file.path)
        assert now is not None
        seen.append(now.anew - now.started)
    assert max(seen[:2]) < 0, "never"
    assert 0 <= seen[2] == seen[3] < 600


def test_a_file_that_a_power_loss_left_empty_is_no_status(tmp_path: Path) -> None:
    (tmp_path / "train.json").touch()
    assert read(tmp_path / "train.json") is None
    file = StatusFile(tmp_path / "train.json")
    file.begin("train a", "train")
    file.end("done")
    assert [one.state for one in read_all(tmp_path)] == ["done"]


def test_what_was_there_before_can_be_put_back(tmp_path: Path) -> None:
    file = StatusFile(tmp_path / "train.json")
    file.begin("train a", "train")
    file.end("done")
    before = read(file.path)
    assert before is not None
    file.begin("train a", "train")
    file.restore(before)
    assert read(file.path) == before


def test_only_what_is_not_seen_here_is_learnt(tmp_path: Path) -> None:
    here, elsewhere = StatusFile(tmp_path / "here.json"), StatusFile(tmp_path / "there.json")
    here.begin("sfm a", "sfm")
    here.end_elsewhere("sfm a", "sfm", "failed", 0.0, "lost")
    elsewhere.end_elsewhere("train a", "train", "done", 12.5)
    states = {status.title: status.state for status in read_all(tmp_path)}
    assert states == {"sfm a": "running", "train a": "done"}
    learnt = read(elsewhere.path)
    assert learnt is not None
    assert round(learnt.seconds, 1) == 12.5


def test_a_stage_whose_file_was_taken_away_ends_now_and_took_no_time(tmp_path: Path) -> None:
    StatusFile(tmp_path / "train.json").end("done")
    found = read(tmp_path / "train.json")
    assert found is not None
    assert (found.state, found.seconds) == ("done", 0)


def test_a_warning_stays_with_a_stage_that_ended_well(tmp_path: Path) -> None:
    good, bad = StatusFile(tmp_path / "agree.json"), StatusFile(tmp_path / "train.json")
    for file, state in ((good, "done"), (bad, "failed")):
        file.begin(file.path.stem, file.path.stem)
        file.end(state, "broken" if state == "failed" else "")  # type: ignore[arg-type]
        file.warn("masks cover the frame")
    notes = {status.title: status.note for status in read_all(tmp_path)}
    assert notes == {"agree": "masks cover the frame", "train": "broken"}
    StatusFile(tmp_path / "none.json").warn("nobody ran")
    assert not (tmp_path / "none.json").exists()


def test_a_stage_that_was_planned_anew_meanwhile_took_no_time_and_makes_no_progress(
    tmp_path: Path,
) -> None:
    """Two runs of one name in one folder: the second plans the grid while the first works."""
    file = StatusFile(tmp_path / "train.json")
    file.begin("train a", "train", "train/1")
    file.plan("train a", "train")
    file.progress(10, 10, "24 dB")
    planned = read(file.path)
    assert planned is not None
    assert (planned.state, planned.done, planned.key) == ("waiting", 0, "train/1")
    file.end("done")
    found = read(file.path)
    assert found is not None
    assert (found.state, found.seconds) == ("done", 0)
    assert found.started > 0
