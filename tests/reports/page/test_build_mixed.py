"""Reports of rows that do not all compare: other settings, doubts, scores that some lack."""

from collections.abc import Callable
from copy import deepcopy
from math import inf
from pathlib import Path
from typing import Any

import pytest

from reports.page.build import build
from reports.rows.settings import of_one_setting, setting_notes
from reports.tables import verdict
from reports.tables.side_tables import BUDGETS, all_tables
from tests.reports.rows.test_budgets import grid

pytestmark = pytest.mark.usefixtures("rough_figures")

Row = dict[str, Any]
DOUBT = [{"about": "masks", "text": "masks fill the frame", "serious": True}]


def raised(row: Row, gain: float) -> Row:
    """Return the row with all views' PSNR that much higher."""
    views = [
        view | {name: view[name] + gain for name in ("psnr", "mask_psnr")}
        for view in row["per_view"]
    ]
    return row | {"per_view": views}


def words_of(rows: list[Row], folder: Path) -> str:
    build(rows, folder, title="Toy", artifacts_root=None)
    return (folder / "report.md").read_text(encoding="utf-8")


def pairs(make_row: Callable[..., Row], captures: str, gain: float = 0.5) -> list[Row]:
    """Return 3DGS and an `ours` that gains, without background, for each capture."""
    rows = []
    for name in captures:
        base = make_row(name, "nobg", "3dgs")
        ours = make_row(name, "nobg", "ours") | {"per_view": deepcopy(base["per_view"])}
        rows += [base, raised(ours, gain)]
    return rows


def test_longer_runs_are_not_compared_with_short_ones(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    short = pairs(make_row, "ab")
    longer = [raised(row, 5.0) | {"iterations": 30000} for row in short[:2]]
    words = words_of([*longer, *short], tmp_path)
    assert "Ours gains over 3DGS on both captures; on average +0.50 dB" in words
    assert "5.50 dB" not in words
    note = "are of 1,000 iterations at 320 px, at which most experiments finished"
    assert note in words
    assert "30,000 iterations at 320 px (2 experiments)" in words


def test_of_settings_with_as_many_experiments_the_longest_is_compared(
    make_row: Callable[..., Row],
) -> None:
    short = pairs(make_row, "a")
    longer = [row | {"iterations": 30000} for row in short]
    assert of_one_setting([*short, *longer]) == longer
    assert setting_notes(short) == []


def test_captures_in_doubt_count_in_no_mean(make_row: Callable[..., Row], tmp_path: Path) -> None:
    doubted = [row | {"warnings": DOUBT} for row in pairs(make_row, "c", 10.0)]
    rows = [*pairs(make_row, "ab"), *doubted]
    words = words_of(rows, tmp_path)
    table = next(one for one in all_tables(rows) if one.slug == "table-differences")
    mean = next(group for group in table.groups if group.label.startswith("Mean over"))
    assert mean.lines[0].entries[0].value == pytest.approx(0.5)
    assert "Means over captures leave out those in doubt: c (masks)." in table.notes
    assert "Ours on 2 of 2 captures" in words, "the figure's caption counts two"


def test_warnings_and_incidents_do_not_hang_on_the_order_of_rows(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    rows = pairs(make_row, "ab")
    for number, row in enumerate(rows):
        row["warnings"] = [{"about": "masks", "text": f"mask {number} is odd", "serious": False}]
        row["registration"]["fallbacks"] = [f"step {number}"]
    assert words_of(rows, tmp_path / "one") == words_of(rows[::-1], tmp_path / "other")


def test_a_row_trained_on_held_out_views_gets_no_verdict(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    rows = pairs(make_row, "ab")
    leaked = rows[1]["per_view"][0]["view"]
    rows[1] = rows[1] | {"trained_on": [leaked, "other.jpg"]}
    words = words_of(rows, tmp_path)
    assert f"a: nobg-ours was trained on held-out views, such as {leaked}. No verdict" in words
    assert "a: no verdict. Its held-out views are in doubt" in words


def test_scores_in_the_mask_and_over_the_frame_are_not_averaged(
    make_row: Callable[..., Row],
) -> None:
    rows = pairs(make_row, "abc")
    for row in rows[:2]:
        for view in row["per_view"]:
            view["mask_psnr"] = None
    found = verdict.overall(rows)
    assert found is not None
    assert found.headline.startswith(
        "Without backgrounds, Ours gains over 3DGS on 2 of 3 captures and is not measured by the "
        "same score on 1; on average +0.50"
    )
    assert "dB inside the mask" in found.headline


def test_captures_without_a_shared_view_are_counted_as_such(make_row: Callable[..., Row]) -> None:
    rows = pairs(make_row, "abc")
    rows[0]["per_view"] = []
    found = verdict.overall(rows)
    assert found is not None
    assert "on 2 of 3 captures and has no view in common on 1" in found.headline


def test_a_score_that_is_not_finite_is_left_out_and_named(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    rows = pairs(make_row, "a")
    rows[1]["per_view"][0]["mask_psnr"] = inf
    words = words_of(rows, tmp_path)
    view = rows[1]["per_view"][0]["view"]
    assert f"row 1 (a/nobg-ours, seed 0): mask_psnr of {view} is inf, left out" in words
    assert "Ours gains 0.50 dB inside the mask" in words


def test_a_failed_row_may_hold_nothing_but_its_reason(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    rows = pairs(make_row, "a")
    rows[1] |= {"status": "failed", "reason": "train: out of memory"}
    rows[1] |= {"metrics": None, "per_view": None}
    assert "train: out of memory" in words_of(rows, tmp_path)


def test_a_mean_over_some_captures_says_over_how_many(make_row: Callable[..., Row]) -> None:
    rows = grid(make_row)
    for row in rows:
        if row["capture"] == "hexapod" and row["method"] == "3dgs":
            row["metrics"]["mask_psnr"] -= 20  # curves that share nothing
    mean = next(one for one in all_tables(rows) if one.slug == BUDGETS).groups[0].lines[0]
    assert mean.label == "Ours+"
    assert mean.entries[0].text.endswith(", 1 of 2")
