"""Rows are judged only when they are of a run that ended, and of the one that was meant."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from socket import gethostname
from typing import Any

import pytest

from flows import run_record, scheduled
from flows.cli import run as running
from flows.gate import judge, make_baseline
from flows.run_record import RunRecord
from mattgs_ops.config import BenchmarkConfig, RunConfig
from mattgs_ops.errors import InputError, MattgsError
from reports.gate import baseline
from reports.gate.findings import Exit

NAME = "quick-ci"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a benchmark's folder with the rows of yesterday's run, which was good."""
    folder = tmp_path / "benchmarks" / NAME
    record = run_record.begin(folder, "yesterday")
    write_rows(folder)
    run_record.end(folder, record)
    return folder


def write_rows(folder: Path, **change: Any) -> None:
    rows = [row | change for row in baseline.load(NAME).rows]
    (folder / "rows.json").write_text(json.dumps(rows))


def judged(folder: Path, run: str | None = None) -> tuple[str, int]:
    return judge(folder.parents[1], NAME, NAME, run=run)


def test_a_run_that_ended_is_judged(folder: Path) -> None:
    for run in (None, "yesterday"):
        text, code = judged(folder, run)
        assert code == Exit.PASS, text


def test_a_grid_that_was_killed_does_not_pass_on_yesterdays_numbers(folder: Path) -> None:
    run_record.begin(folder, "tonight")  # and nothing more
    for run in (None, "tonight"):
        text, code = judged(folder, run)
        assert code == Exit.FAILED_RUNS
        assert "tonight" in text
        assert "has not ended" in text
    with pytest.raises(InputError, match="has not ended"):
        make_baseline(folder.parents[1], NAME, folder / "new.json")


def test_a_run_that_broke_off_says_why(folder: Path) -> None:
    run_record.end(folder, run_record.begin(folder, "tonight"), "no space left")
    text, code = judged(folder)
    assert code == Exit.FAILED_RUNS
    assert "broke off: no space left" in text


def test_another_run_or_none_is_not_the_one_that_was_meant(folder: Path, tmp_path: Path) -> None:
    text, code = judged(folder, "tonight")
    assert (code, "the rows are of the run yesterday" in text) == (Exit.FAILED_RUNS, True)
    write_rows(folder, reason="by somebody else")
    text, code = judged(folder, "yesterday")
    assert (code, "not those that the run yesterday wrote" in text) == (Exit.FAILED_RUNS, True)
    assert "never began" in run_record.problem(tmp_path / "nowhere", "tonight")
    assert run_record.problem(tmp_path / "nowhere") == "", "rows that no record speaks of"


def test_an_interrupted_measurement_goes_on_and_a_finished_one_begins_anew(tmp_path: Path) -> None:
    first = run_record.begin(tmp_path, remeasure=True)
    assert first.sitting == first.id
    assert run_record.begin(tmp_path, remeasure=True).sitting == first.id
    (tmp_path / "rows.json").write_text("[]")
    last = run_record.begin(tmp_path, remeasure=True)
    run_record.end(tmp_path, last)
    assert run_record.begin(tmp_path, remeasure=True).sitting not in (first.id, None)
    assert run_record.begin(tmp_path).sitting is None


def test_a_benchmark_leaves_a_record_of_how_it_went(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The benchmark itself is replaced: what is tried is what is noted about it."""
    config = BenchmarkConfig(name=NAME)
    folder = tmp_path / "benchmarks" / NAME
    seen: list[RunConfig] = []

    def good(config: BenchmarkConfig, out: Path, died: int, record: RunRecord) -> bool:
        assert (died, record.id) == (1, "one")
        seen.append(config.run)
        write_rows(out / "benchmarks" / NAME)
        return True

    def interrupted(*_: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "_run", good)
    assert running.run_benchmark(config, tmp_path, run="one", remeasure=True)
    assert run_record.problem(folder, "one") == ""
    assert seen[0].sitting == "one"
    monkeypatch.setattr(running, "_run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        running.run_benchmark(config, tmp_path, run="two")
    assert "the run two" in run_record.problem(folder)
    assert "broke off: it was interrupted" in run_record.problem(folder)


def closed(*_: object) -> bool:
    try:
        raise BrokenPipeError
    except BrokenPipeError:
        raise SystemExit(1)  # noqa: B904 - as Rich does


def refused(*_: object) -> bool:
    raise SystemExit(7)


@pytest.mark.parametrize(
    ("ends", "reason"),
    [
        (closed, "what read its output has ended"),
        (refused, "a library ended it with exit code 7"),
    ],
)
def test_a_run_that_a_library_ends_says_why_in_words(
    ends: Callable[..., bool], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As ``mattgs run | head -1`` does, where a line that nobody reads ends the program."""
    monkeypatch.setattr(running, "_run", ends)
    with pytest.raises(MattgsError, match=f"^{reason}; the same command goes on from here$"):
        running.run_benchmark(BenchmarkConfig(name=NAME), tmp_path)
    assert run_record.problem(tmp_path / "benchmarks" / NAME).endswith(f"broke off: {reason}")


def in_another_process(folder: Path, run: str) -> RunRecord:
    """Begin a run in a process that lives while this test does."""
    record = replace(run_record.begin(folder, run), process=os.getppid())
    run_record._write(folder, record)
    return record


def test_a_run_that_ends_leaves_the_record_of_a_newer_one(tmp_path: Path) -> None:
    older = in_another_process(tmp_path, "older")
    newer = run_record.begin(tmp_path, "newer")
    assert newer.beside == ((os.getppid(), gethostname()),)
    assert older.beside == ()
    for reason in ("", "interrupted"):
        run_record.end(tmp_path, older, reason)
        assert run_record.read(tmp_path) == newer
    (tmp_path / "rows.json").write_text("[]")
    run_record.end(tmp_path, newer)
    assert run_record.problem(tmp_path, "newer") == ""


def test_nothing_is_over_while_an_older_run_of_the_name_is_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_another_process(tmp_path, "older")
    for run in ("newer", "newest"):
        run_record.end(tmp_path, run_record.begin(tmp_path, run), "no space left")
        assert not run_record.over(tmp_path)
    monkeypatch.setattr(run_record, "gone", lambda process, _: process == os.getppid())
    assert run_record.over(tmp_path)
    assert run_record.begin(tmp_path).beside == ()


@pytest.mark.usefixtures("folder")
def test_the_first_night_makes_a_baseline_of_a_good_run_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    monkeypatch.setattr(scheduled, "create_markdown_artifact", lambda text, **_: told.append(text))
    file = tmp_path / "baseline.json"
    with pytest.raises(scheduled.GateError, match="no baseline was made"):
        scheduled._first(NAME, file, tmp_path, "tonight")
    assert not file.exists()
    scheduled._first(NAME, file, tmp_path, "yesterday")
    assert baseline.load(file).name == NAME
    assert "it was made of this run (yesterday). Nothing was judged." in told[0]
    assert judge(tmp_path, NAME, str(file), run="yesterday")[1] == Exit.PASS
