"""How long a run still takes: counted by hand on small grids."""

from dataclasses import replace

import pytest

from flows.cli.time_left import TYPICAL, in_words, seconds_left
from tasks.stages.status import Status

NOW = 1000.0


def done(kind: str, seconds: float) -> Status:
    return Status(f"{kind} x", kind, "done", started=NOW - seconds, updated=NOW)


def running(kind: str, since: float, share: float) -> Status:
    part = round(100 * share)
    return Status(f"{kind} x", kind, "running", part, 100, started=NOW - since, updated=NOW)


def waiting(kind: str) -> Status:
    return Status(f"{kind} x", kind)


def test_nothing_is_said_before_anything_is_known() -> None:
    assert seconds_left([waiting("sfm"), running("segment", 3, 0.0)], 2, NOW) is None
    assert in_words(None) == ""


def test_kinds_that_ended_tell_of_those_to_come() -> None:
    stages = [done("train", 40), done("train", 60), waiting("train"), waiting("train")]
    assert seconds_left(stages, 1, NOW) == pytest.approx(100)
    assert seconds_left(stages, 2, NOW) == pytest.approx(50)


def test_a_slow_machine_is_slow_at_what_it_has_not_done_yet() -> None:
    stages = [done("prepare", 3 * TYPICAL["prepare"]), waiting("sfm"), waiting("measure")]
    expected = 3 * (TYPICAL["sfm"] / 2 + TYPICAL["measure"])  # measuring has the machine alone
    assert seconds_left(stages, 2, NOW) == pytest.approx(expected)


def test_a_running_stage_goes_on_at_its_own_pace() -> None:
    assert seconds_left([running("sfm", 30, 0.25)], 1, NOW) == pytest.approx(90)
    # too early to tell: as long as the others of its kind
    stages = [done("train", 50), running("train", 10, 0.01)]
    assert seconds_left(stages, 1, NOW) == pytest.approx(40)
    assert seconds_left([done("train", 50), running("train", 80, 0.01)], 1, NOW) == 0


def test_a_further_attempt_goes_on_at_the_pace_of_its_own() -> None:
    attempt = replace(running("sfm", 130, 0.25), anew=NOW - 30)
    assert seconds_left([attempt], 1, NOW) == pytest.approx(90)


def test_what_was_in_the_store_says_nothing_about_speed() -> None:
    cached = Status("train x", "train", "cached", started=NOW - 0.1, updated=NOW)
    stages = [cached, done("train", 50), waiting("train")]
    assert seconds_left(stages, 1, NOW) == pytest.approx(50)
    assert seconds_left([cached, waiting("train")], 1, NOW) is None


def test_it_is_said_in_minutes() -> None:
    assert in_words(244) == "about 4 min left"
    assert in_words(20) == "less than a minute left"
