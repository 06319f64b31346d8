"""An error of the disk says which place is full, or what else keeps files from being written."""

import errno
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from mattgs_ops.errors import ROOM, full_among, of_the_disk


def error(number: int, *more: object) -> OSError:
    return OSError(number, os.strerror(number), *more)


@pytest.fixture
def nearly_full(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the temporary folder's file system, or any other, a byte too little room."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=ROOM - 1))


def test_a_file_that_the_error_names_is_the_place(tmp_path: Path) -> None:
    told = of_the_disk(error(errno.ENOSPC, "a.json"), [tmp_path])
    assert told == "a.json: No space left on device"


@pytest.mark.usefixtures("nearly_full")
def test_without_a_name_the_places_without_room_are_named_once_a_file_system(
    tmp_path: Path,
) -> None:
    below = tmp_path / "out"
    below.mkdir()
    assert (
        of_the_disk(error(errno.ENOSPC), [below, tmp_path]) == f"{below}: No space left on device"
    )
    assert full_among([tmp_path / "not" / "there"]) == [tmp_path]


def test_where_there_is_room_no_place_is_blamed(tmp_path: Path) -> None:
    assert of_the_disk(error(errno.ENOSPC), [tmp_path]) == "No space left on device"


def test_a_limit_on_the_size_of_files_is_called_one(tmp_path: Path) -> None:
    assert "ulimit -f" in str(of_the_disk(error(errno.EFBIG), [tmp_path]))


@pytest.mark.parametrize("number", [errno.ENOENT, errno.EACCES, errno.EROFS, errno.ECONNREFUSED])
def test_other_errors_are_not_the_disks(number: int, tmp_path: Path) -> None:
    assert of_the_disk(error(number, "a.json"), [tmp_path]) is None
    assert of_the_disk(OSError("of a library, without a number"), [tmp_path]) is None
