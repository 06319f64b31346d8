"""The schema of rows: what is refused, by which words, and how rows form cells."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from reports.rows import schema

Row = dict[str, Any]


def test_good_rows_have_no_problems(make_grid: Callable[..., list[Row]]) -> None:
    assert schema.problems(make_grid(seeds=2)) == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"schema": 2}, "`schema`"),
        ({"seed": "0"}, "`seed`"),
        ({"seed": True}, "`seed`"),
        ({"background": "green"}, "`background`"),
        ({"condition": "nobg-ours"}, "`condition`"),
        ({"status": "done"}, "`status`"),
        ({"status": "failed", "reason": None}, "`reason`"),
        ({"per_view": [{"view": "a.jpg"}]}, "`per_view[0]`"),
        ({"benchmark": "../../../evil"}, "`benchmark`"),
        ({"run_id": "../x"}, "`run_id`"),
        ({"artifacts": {"evaluate": "/etc"}}, "`artifacts.evaluate`"),
    ],
)
def test_a_problem_names_its_field(make_row: Callable[..., Row], change: Row, word: str) -> None:
    found = schema.problems([make_row("rover", "original", "3dgs") | change])
    assert any(word in text and "rover/" in text for text in found), found


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"benchmark": "../../../evil"}, "row 1: `benchmark`: expected .*, found '../../../evil'"),
        ({"capture": "a/../../b"}, "row 1: `capture`: expected .*, found 'a/../../b'"),
        ({"artifacts": {"scene": "../../etc"}}, "row 1: `artifacts.scene`: .*, found '../../etc'"),
    ],
)
def test_rows_that_lead_elsewhere_are_refused_when_they_are_read(
    make_row: Callable[..., Row], tmp_path: Path, change: Row, says: str
) -> None:
    good = make_row("rover", "original", "3dgs")
    path = tmp_path / "rows.json"
    path.write_text(json.dumps([good, good | change]))
    with pytest.raises(InputError, match=says) as caught:
        schema.read_rows(path)
    assert str(path) in str(caught.value)
    with pytest.raises(InputError, match=says):
        schema.refused([good, good | change])


def test_a_missing_field_is_named(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "original", "3dgs")
    del row["iterations"]
    assert schema.row_problems(row) == ["`iterations` is missing"]


@pytest.mark.parametrize("value", [math.nan, math.inf, "23", None])
def test_metrics_are_finite_numbers(make_row: Callable[..., Row], value: object) -> None:
    row = make_row("rover", "original", "3dgs")
    row["metrics"]["psnr"] = value
    assert "`metrics.psnr`" in schema.row_problems(row)[0]


def test_the_same_seed_twice_is_a_problem(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "original", "3dgs")
    assert "appears twice" in schema.problems([row, row])[0]


def test_failed_rows_need_no_scores(make_failed: Callable[..., Row]) -> None:
    row = make_failed("rover", "nobg", "ours", "out of memory")
    for field in schema.MAY_LACK:
        del row[field]
    assert schema.problems([row]) == []


def test_refused_rows_become_failed_ones_that_say_why(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "original", "3dgs")
    row["metrics"]["psnr"] = math.nan
    (out,) = schema.refused([row])
    assert out["status"] == "failed"
    assert "metrics.psnr" in out["reason"]


def test_a_row_without_identity_is_an_error(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "original", "3dgs")
    del row["capture"]
    with pytest.raises(InputError, match="`capture` is missing"):
        schema.refused([row])


def test_cells_come_in_the_papers_order_whatever_the_rows_order(
    make_grid: Callable[..., list[Row]],
) -> None:
    grid = make_grid(captures=("zebra", "lattepanda", "rover"), seeds=2)
    forward, backward = schema.cells(grid), schema.cells(grid[::-1])
    assert forward == backward
    names = [(c.key.capture, c.key.condition) for c in forward]
    assert names[:5] == [
        ("rover", "original-3dgs"),
        ("rover", "original-ours"),
        ("rover", "nobg-3dgs"),
        ("rover", "nobg-ours"),
        ("lattepanda", "original-3dgs"),
    ]
    assert names[-1][0] == "zebra"
    assert [row["seed"] for row in forward[0].finished] == [0, 1]


def test_rows_are_read_from_a_list_or_an_object(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    for text in ('[{"a": 1}]', '{"rows": [{"a": 1}]}'):
        path.write_text(text)
        assert schema.read_rows(path) == [{"a": 1}]
    path.write_text('{"rows": 3}')
    with pytest.raises(InputError, match=r"rows\.json"):
        schema.read_rows(path)


def test_bytes_that_are_no_text_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    path.write_bytes('[{"capture": "Gerät"}]'.encode("latin-1"))
    with pytest.raises(InputError, match=r"rows\.json: expected a readable JSON file of rows"):
        schema.read_rows(path)
