"""Images of other settings are told from those that were asked for, by name."""

import json
from pathlib import Path

import pytest

from mattgs_ops.errors import InputError
from mattgs_ops.synthetic.made_file import FILE, check_folder, check_same, write_made

MADE = {"seed": 1, "size": 0.1, "world": {"plain": 0.4}, "variant": None}


def test_the_same_making_is_taken_whatever_else_the_file_says(tmp_path: Path) -> None:
    check_same(tmp_path / FILE, MADE, "images")  # nothing is there yet
    write_made(tmp_path / FILE, {**MADE, "corners": [1, 2]})
    check_same(tmp_path / FILE, MADE, "images")
    check_folder(tmp_path, MADE)
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


def test_what_differs_is_named(tmp_path: Path) -> None:
    write_made(tmp_path / FILE, MADE)
    other = {**MADE, "seed": 2, "world": {"plain": 0.5}}
    message = (
        r"made\.json: expected images made with seed 2, world \{'plain': 0\.5\}, "
        r"found seed 1, world \{'plain': 0\.4\}$"
    )
    with pytest.raises(InputError, match=message):
        check_folder(tmp_path, other)
    with pytest.raises(InputError, match="expected a set made with views 3, found views None"):
        check_same(tmp_path / FILE, {"views": 3}, "a set")


def test_a_folder_that_does_not_tell_is_refused_unless_it_is_empty(tmp_path: Path) -> None:
    check_folder(tmp_path / "none", MADE)
    (tmp_path / "images").mkdir()
    (tmp_path / f"{FILE}.part").write_text("{")  # of a process that was killed
    check_folder(tmp_path, MADE)
    (tmp_path / "images" / "0000.png").touch()
    with pytest.raises(InputError, match=r"expected made\.json .* found images/0000\.png without"):
        check_folder(tmp_path, MADE)


@pytest.mark.parametrize("text", ["", '{"seed": 1', json.dumps([MADE])])
def test_a_broken_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(InputError, match=r"made\.json: expected (JSON|a table)"):
        check_folder(tmp_path, MADE)
