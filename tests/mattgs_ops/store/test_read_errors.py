"""A store on a disk or a file server that does not answer once."""

import errno
from pathlib import Path

import pytest

from mattgs_ops.errors import StageError
from mattgs_ops.store import store as store_module
from mattgs_ops.store.store import Store
from tests.mattgs_ops.store.test_store import KEY, make


def test_a_disk_that_does_not_answer_is_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file server's hiccup must not cost a training."""
    store = Store(tmp_path)
    make(store)

    def stale(path: Path) -> str:
        raise OSError(errno.ESTALE, "Stale file handle", str(path))

    with monkeypatch.context() as broken:
        broken.setattr(store_module, "file_digest", stale)
        with pytest.raises(StageError, match=r"cannot be read: .*Stale file handle"):
            make(store)
    assert (store.require(KEY).folder / "a.txt").read_text() == "result"
