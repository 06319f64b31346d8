"""Names and paths from outside: those that would lead out of their folder are refused by name."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mattgs_ops.errors import InputError
from mattgs_ops.naming import (
    MOST_LETTERS,
    below,
    checked_name,
    checked_row,
    is_below,
    is_name,
    listed_names,
    numbers_by_value,
    row_problems,
    slug,
)

ESCAPES = ["../evil", "a/../../b", "/etc/passwd", "..", ".", "", "a//b", "a/./b", "a/", "a\0b"]


@pytest.mark.parametrize("text", ["rover", "ours+", "a..b", "3dgs", "x" * MOST_LETTERS, "v1.2_b-c"])
def test_what_names_may_be(text: str) -> None:
    assert checked_name(text, "`name`") == text


@pytest.mark.parametrize(
    "text", [*ESCAPES, "a/b", ".hidden", "-rf", "a b", "a\n", "é", "x" * (MOST_LETTERS + 1)]
)
def test_what_names_may_not_be_is_refused_naming_field_and_value(text: str) -> None:
    with pytest.raises(InputError) as caught:
        checked_name(text, "`methods`")
    assert str(caught.value).startswith("`methods`: expected letters, digits")
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize("path", ["a", "a/b.txt", "..a/b..", "train/0a/files", "a photo (1).jpg"])
def test_a_path_below_its_folder_is_joined_to_it(tmp_path: Path, path: str) -> None:
    assert below(tmp_path, path, "`files`") == tmp_path / path


@pytest.mark.parametrize("path", ESCAPES)
def test_a_path_that_leaves_its_folder_is_refused(tmp_path: Path, path: str) -> None:
    with pytest.raises(InputError, match=r"`files`: expected a path below its folder.*, found "):
        below(tmp_path, path, "`files`")


@given(st.text(alphabet="a./\\\0 ", max_size=12))
def test_no_accepted_path_leads_out_of_its_folder(text: str) -> None:
    folder = Path("/base/folder")
    if is_below(text):
        joined = Path(*(part for part in (folder / text).parts if part != "."))
        assert ".." not in joined.parts
        assert joined.is_relative_to(folder)
        assert joined != folder


@given(st.text(max_size=40))
def test_a_slug_is_one_part_of_a_path(text: str) -> None:
    assert is_below(f"run-{slug(text)}")
    assert "/" not in slug(text)


def test_valid_names_stay_and_other_runs_become_one_dash() -> None:
    assert slug("ours+_2.5-b") == "ours+_2.5-b"
    assert slug("train rover nobg-ours+ seed 0") == "train-rover-nobg-ours+-seed-0"
    assert slug("../../a b/é") == "..-..-a-b-"


def test_what_is_kept_can_be_chosen() -> None:
    assert slug("ours+_2.5", keep="") == "ours-2-5"
    assert slug("ours+_2.5", keep="-_.") == "ours-_2.5"


@pytest.mark.parametrize("value", [3, None, b"a", ["a"]])
def test_only_text_is_a_name_or_a_path(value: Any) -> None:
    assert not is_name(value)
    assert not is_below(value)


ROW = {
    "benchmark": "quick", "capture": "rover", "condition": "nobg-" + "m" * MOST_LETTERS,
    "method": "m" * MOST_LETTERS, "run_id": None, "artifacts": {"train": "train/ab/files"},
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"benchmark": "../../../evil"}, "`benchmark`"),
        ({"capture": "a/../../b"}, "`capture`"),
        ({"method": "/etc"}, "`method`"),
        ({"condition": "nobg-../x"}, "`condition`"),
        ({"run_id": "../run"}, "`run_id`"),
        ({"benchmark": 7}, "`benchmark`"),
        ({"artifacts": {"train": "../../home"}}, "`artifacts.train`"),
        ({"artifacts": {"scene": "/etc"}}, "`artifacts.scene`"),
    ],
)
def test_a_row_that_leads_elsewhere_is_refused_by_its_field(
    change: dict[str, Any], field: str
) -> None:
    assert row_problems(ROW) == []
    with pytest.raises(InputError, match=f"rows.json: row 3: {field}: expected .*, found "):
        checked_row(ROW | change, "rows.json: row 3")


def test_what_is_no_row_is_said_so() -> None:
    with pytest.raises(InputError, match="expected a row, found list"):
        checked_row([], "rows.json")


def test_numbers_in_names_are_sorted_by_their_value() -> None:
    names = ["a/2.jpg", "a/10.jpg", "a/10_2.jpg", "a/10_10.jpg", "b01.jpg", "b1.jpg", "b.jpg"]
    shuffled = names[3:] + names[:3]
    assert sorted(shuffled, key=numbers_by_value) == names
    assert numbers_by_value("01.jpg") != numbers_by_value("1.jpg")


def test_long_lists_are_cut() -> None:
    assert listed_names(["a", "b"], 8) == "a, b"
    assert listed_names([str(n) for n in range(10)], 8) == "0, 1, 2, 3, 4, 5, 6, 7 and 2 more"
