"""Times compare by the wall's clock, unless trainings waited for their cores."""

from pathlib import Path

import pytest

from reports.page.build import build
from reports.rows import clock
from reports.rows.schema import Row
from reports.tables import verdict
from tests.reports.conftest import cell_row


def timed(method: str, wall: float, cpu: float | None, threads: int = 1) -> Row:
    row = cell_row("rover", "nobg", method)
    row["metrics"] |= {"time": wall} | ({} if cpu is None else {"time_cpu": cpu})
    row["provenance"] |= {"threads": threads}
    return row


@pytest.mark.parametrize(
    ("wall", "cpu", "threads", "expected"),
    [
        (100, 99, 1, False),
        (140, 99, 1, False),
        (160, 99, 1, True),
        (55, 100, 2, False),  # two threads never do the work of two
        (80, 100, 2, True),
    ],
)
def test_a_training_waited_when_its_cores_did_something_else(
    wall: float, cpu: float, threads: int, expected: bool
) -> None:
    assert clock.waited(timed("ours+", wall, cpu, threads)) == expected


def test_claims_go_by_cpu_time_where_a_training_waited() -> None:
    rows = [timed("3dgs", 300, 100), timed("ours+", 60, 50)]
    assert clock.clock_of(rows) == "time_cpu"
    (one,) = verdict.verdicts(rows)
    assert "50 % less CPU time" in one.headline  # by the wall it would be 80 %
    assert "CPU time × 0.50" in one.details[0]
    quiet = [timed("3dgs", 100, 100), timed("ours+", 20, 20)]
    (one,) = verdict.verdicts(quiet)
    assert "80 % less training time" in one.headline


def test_where_cpu_times_are_not_known_the_wall_counts_and_a_reader_is_told() -> None:
    rows = [timed("3dgs", 300, 100), timed("ours+", 60, None)]
    assert clock.clock_of(rows) == "time"
    (note,) = clock.clock_notes(rows)
    assert "1 of 2 waited" in note
    assert "not all rows know their CPU time" in note
    assert clock.clock_notes([timed("3dgs", 100, 100)]) == []


def test_a_report_says_so_and_calls_no_time_the_best(tmp_path: Path) -> None:
    rows = [timed("3dgs", 300, 100), timed("ours+", 60, 50)]
    build(rows, tmp_path, title="T", artifacts_root=None)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "Time is not to be trusted here" in text
    assert "1m 00s" in text
    assert "**1m 00s**" not in text
    for row in rows:
        row["metrics"]["time"] = row["metrics"]["time_cpu"]
    build(rows, tmp_path, title="T", artifacts_root=None)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "not to be trusted" not in text
    assert "**50 s**" in text
