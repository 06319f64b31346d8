"""A file is as it was until the new one is complete."""

import errno
import os
from pathlib import Path

import pytest

from mattgs_ops.whole_file import write_text_whole, written_whole


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


def test_text_has_the_same_bytes_on_any_system_and_its_folder_is_made(tmp_path: Path) -> None:
    write_text_whole(tmp_path / "new" / "a.md", "ä\nb\n")
    assert (tmp_path / "new" / "a.md").read_bytes() == "ä\nb\n".encode()


def test_an_error_of_the_disk_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("before")
    (tmp_path / "a.json.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as raised:
        write_text_whole(path, "after")
    assert raised.value.filename == str(path)
    assert path.read_text() == "before"


def test_a_place_that_is_taken_or_missing_is_named_as_users_know_it(tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    for path in (tmp_path / "made", tmp_path / "missing" / "a.json"):
        with pytest.raises(OSError, match=path.name) as raised, written_whole(path) as partial:
            partial.touch()
        assert raised.value.filename == str(path)


def test_an_error_of_something_else_names_what_it_named(tmp_path: Path) -> None:
    refused = OSError(errno.ECONNREFUSED, os.strerror(errno.ECONNREFUSED))
    with pytest.raises(OSError, match="refused") as raised, written_whole(tmp_path / "a.json"):
        raise refused
    assert raised.value.filename is None
