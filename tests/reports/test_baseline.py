"""Baselines: read back what was written, notice edits, and come up from older schemas."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from reports import baseline
from reports.gate import Exit, compare
from reports.rows import problems

Row = dict[str, Any]


def test_what_is_read_is_what_was_written(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    made = baseline.make(make_grid(), "quick", {"time": 0.02})
    path = tmp_path / "deep" / "quick.json"
    made.save(path)
    read = baseline.load(path)
    assert read == made
    assert read.machine["cpu"] == ["A CPU"]
    assert compare(make_grid(), read.rows, noise=read.noise).exit_code == Exit.PASS
    again = tmp_path / "again.json"
    read.save(again)
    assert again.read_bytes() == path.read_bytes()


def test_training_views_keep_their_names_only(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "nobg", "3dgs")
    row["per_view"].append({"view": "0001.jpg", "split": "train", "psnr": 30.0})
    (kept,) = baseline.make([row], "quick").rows
    assert kept["per_view"][-1] == {"view": "0001.jpg", "split": "train"}
    assert problems([kept]) == []


def test_a_number_edited_by_hand_is_noticed(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    path = tmp_path / "quick.json"
    baseline.make(make_grid(), "quick").save(path)
    document = json.loads(path.read_text())
    document["rows"][0]["metrics"]["psnr"] -= 1
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="digest differs"):
        baseline.load(path)


def test_version_1_is_migrated(make_grid: Callable[..., list[Row]], tmp_path: Path) -> None:
    rows = make_grid()
    path = tmp_path / "old.json"
    path.write_text(json.dumps({"schema": 1, "name": "old", "rows": rows}))
    read = baseline.load(path)
    assert (read.name, read.protocol, dict(read.noise)) == ("old", 1, {})
    assert list(read.rows) == rows
    read.save(tmp_path / "new.json")
    assert json.loads((tmp_path / "new.json").read_text())["schema"] == baseline.SCHEMA


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("{", "readable"),
        ("[]", "with `rows`"),
        ('{"schema": 3, "rows": []}', "schema 1 to 2, found 3"),
        ('{"schema": "2", "rows": []}', "found '2'"),
        ('{"schema": 2, "rows": []}', "expected machine, name, noise"),
    ],
)
def test_what_is_no_baseline_is_refused_by_name(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "b.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"b\.json") as caught:
        baseline.load(path)
    assert word in str(caught.value)


def test_an_unknown_name_lists_the_committed_ones() -> None:
    with pytest.raises(InputError, match="committed ones"):
        baseline.load("no-such-baseline")


def test_bad_rows_make_no_baseline(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "nobg", "3dgs")
    del row["metrics"]["psnr"]
    with pytest.raises(InputError, match=r"metrics\.psnr"):
        baseline.make([row], "quick")
    with pytest.raises(InputError, match="there are none"):
        baseline.make([], "quick")


def test_every_committed_baseline_can_be_read() -> None:
    for path in baseline.FOLDER.glob("*.json"):
        assert problems(baseline.load(path).rows) == []
