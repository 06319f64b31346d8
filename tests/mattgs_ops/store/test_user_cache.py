"""What is kept in the user's cache is there for the next process, and never needed."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from mattgs_ops.store import code_version, user_cache
from mattgs_ops.store.user_cache import KeptValues


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "mattgs"


def test_values_are_found_by_key_in_a_file_of_their_own(cache: Path) -> None:
    assert KeptValues("some").find("one") is None
    KeptValues("some").keep("one", {"a": [1, None]})
    KeptValues("some").keep("one", {"a": [2, None]})
    assert KeptValues("some").find("one") == {"a": [2, None]}
    assert KeptValues("others").find("one") is None
    assert user_cache.folder() == cache


@pytest.mark.parametrize("content", [b"no database" * 100, b""])
def test_a_file_that_cannot_be_read_holds_nothing_and_is_begun_anew(
    cache: Path, content: bytes
) -> None:
    cache.mkdir(parents=True)
    (cache / "some.db").write_bytes(content)
    assert KeptValues("some").find("one") is None
    for _ in range(2):  # the first may only find that the file is none
        KeptValues("some").keep("one", 1)
    assert KeptValues("some").find("one") == 1


def test_without_a_folder_nothing_is_kept(cache: Path) -> None:
    cache.parent.write_text("a file")
    KeptValues("some").keep("one", 1)
    assert KeptValues("some").find("one") is None


def made(path: Path) -> Path:
    with closing(sqlite3.connect(path)) as database:
        database.executescript("CREATE TABLE things (place); INSERT INTO things VALUES ('here')")
    return path


def things(path: Path) -> list[str]:
    with closing(sqlite3.connect(path)) as database:
        return [place for (place,) in database.execute("SELECT place FROM things")]


def test_a_database_starts_as_a_copy_of_the_one_kept_under_its_name(
    cache: Path, tmp_path: Path
) -> None:
    first = made(tmp_path / "first.db")
    assert not user_cache.copied_database("whole", tmp_path / "other.db")
    user_cache.keep_database("whole", first)
    user_cache.keep_database("emptied", first, without="DELETE FROM things")
    for name, holds in (("whole", ["here"]), ("emptied", [])):
        assert user_cache.copied_database(name, tmp_path / f"{name}.db")
        assert things(tmp_path / f"{name}.db") == holds
    assert things(first) == ["here"]
    assert sorted(path.name for path in cache.iterdir()) == ["emptied.db", "whole.db"]


@pytest.mark.parametrize("left", [0.0, 0.5])
def test_a_database_that_a_crash_left_damaged_is_removed(
    cache: Path, tmp_path: Path, left: float
) -> None:
    user_cache.keep_database("it", made(tmp_path / "first.db"))
    content = (cache / "it.db").read_bytes()
    (cache / "it.db").write_bytes(content[: int(left * len(content))])
    assert not user_cache.copied_database("it", tmp_path / "new.db")
    assert not (cache / "it.db").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "first.db"]


def test_without_a_folder_no_database_is_kept_and_nothing_is_lost(
    cache: Path, tmp_path: Path
) -> None:
    cache.parent.write_text("a file")
    user_cache.keep_database("it", made(tmp_path / "it.db"))
    assert not user_cache.copied_database("it", tmp_path / "new.db")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "it.db"]


def test_a_source_is_parsed_once_for_all_processes_and_again_when_it_says_something_else(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "one.py"
    path.write_text("import numpy\nX = 1\n")
    parsed = code_version._parsed(path, 1, 1)
    assert (cache / "sources.db").is_file()
    code_version._parsed.cache_clear()  # as in another process
    with monkeypatch.context() as broken:
        broken.delattr("ast.parse")
        assert code_version._parsed(path, 1, 1) == parsed
    path.write_text("import numpy\nX = 2\n")
    assert code_version._parsed(path, 2, 1).meaning != parsed.meaning
    assert code_version._parsed(path, 2, 1).imports == ((0, "numpy"),)
