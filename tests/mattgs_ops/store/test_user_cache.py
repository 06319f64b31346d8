"""What is kept in the user's cache is there for the next process, and never needed."""

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
def test_a_file_that_cannot_be_read_holds_nothing(cache: Path, content: bytes) -> None:
    cache.mkdir(parents=True)
    (cache / "some.db").write_bytes(content)
    KeptValues("some").find("one")
    KeptValues("some").keep("one", 1)
    assert KeptValues("some").find("one") == (1 if content == b"" else None)


def test_without_a_folder_nothing_is_kept(cache: Path) -> None:
    cache.parent.write_text("a file")
    KeptValues("some").keep("one", 1)
    assert KeptValues("some").find("one") is None


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
