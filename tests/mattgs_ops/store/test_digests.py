"""Digests see contents and names, and nothing else."""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

from mattgs_ops.errors import InputError
from mattgs_ops.store.digests import (
    file_digest,
    folder_digest,
    json_digest,
    list_files,
    pixels_digest,
    tree_digest,
)


def fill(folder: Path) -> Path:
    (folder / "b").mkdir(parents=True)
    (folder / "a.txt").write_bytes(b"one")
    (folder / "b" / "c.txt").write_bytes(b"two")
    return folder


def test_a_files_digest_is_its_sha256(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * 3_000_000)
    assert file_digest(path) == hashlib.sha256(b"x" * 3_000_000).hexdigest()


def test_folders_of_equal_content_are_equal_wherever_and_whenever(tmp_path: Path) -> None:
    one, two = fill(tmp_path / "one"), fill(tmp_path / "two")
    os.utime(two / "a.txt", (0, 0))
    (two / "empty").mkdir()
    assert folder_digest(one) == folder_digest(two)


@pytest.mark.parametrize("change", ["content", "name", "more", "less", "moved"])
def test_every_change_shows(tmp_path: Path, change: str) -> None:
    folder = fill(tmp_path / "in")
    before = folder_digest(folder)
    if change == "content":
        (folder / "a.txt").write_bytes(b"onE")
    elif change == "name":
        (folder / "a.txt").rename(folder / "A.txt")
    elif change == "more":
        (folder / "d").write_bytes(b"")
    elif change == "less":
        (folder / "a.txt").unlink()
    else:
        (folder / "a.txt").rename(folder / "b" / "a.txt")
    assert folder_digest(folder) != before


def test_names_are_relative_with_forward_slashes(tmp_path: Path) -> None:
    files = list_files(fill(tmp_path / "in"))
    assert list(files) == ["a.txt", "b/c.txt"]
    digests = {name: file_digest(path) for name, path in files.items()}
    assert tree_digest(digests) == folder_digest(tmp_path / "in")


def test_links_are_refused(tmp_path: Path) -> None:
    folder = fill(tmp_path / "in")
    (folder / "link").symlink_to(folder / "a.txt")
    with pytest.raises(InputError, match="link: expected plain files"):
        folder_digest(folder)


def test_json_digests_ignore_order_and_refuse_what_json_cannot_hold() -> None:
    assert json_digest({"a": 1, "b": [1.5, None]}) == json_digest({"b": [1.5, None], "a": 1})
    assert json_digest({"a": 1}) != json_digest({"a": 1.5})
    with pytest.raises(TypeError):
        json_digest({"a": Path("x")})
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_digest({"a": float("nan")})


def test_pixels_count_whatever_order_they_come_in() -> None:
    one, two = np.zeros((2, 3), np.uint8), np.ones((2, 3), np.uint8)
    digest = pixels_digest([("a", one), ("b", two)])
    assert digest == pixels_digest([("b", two), ("a", one.copy(order="F"))])
    assert digest != pixels_digest([("a", two), ("b", one)])
    assert digest != pixels_digest([("a", one.T), ("b", two)])
