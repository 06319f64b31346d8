"""A file is as it was until the new one is complete."""

from pathlib import Path

import pytest

from mattgs_ops.whole_file import written_whole


@pytest.mark.parametrize("by_many", [False, True])
def test_the_file_appears_when_all_of_it_is_written(by_many: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("before")
    with written_whole(path, by_many=by_many) as partial:
        partial.write_text("after")
        assert path.read_text() == "before"
    assert [file.read_text() for file in tmp_path.iterdir()] == ["after"]


def test_an_error_leaves_what_was_there_and_no_rest(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("before")

    def write() -> None:
        with written_whole(path) as partial:
            partial.write_text("af")
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        write()
    assert [file.read_text() for file in tmp_path.iterdir()] == ["before"]


def test_each_of_many_has_its_own_place(tmp_path: Path) -> None:
    with written_whole(tmp_path / "a.json", by_many=True) as mine:
        assert mine != tmp_path / "a.json.part"
        mine.write_text("x")
