"""Copies of unfinished stages on a shared store: another machine goes on from the newest one."""

from pathlib import Path

import fsspec
import pytest

from mattgs_ops.errors import StageError
from mattgs_ops.store.keys import stage_key
from mattgs_ops.store.store import Store

KEY = stage_key("train", "c0de", {"steps": 3}, {"scene": "aa"})


def test_another_machine_goes_on_from_the_newest_draft(tmp_path: Path, url: str) -> None:
    one, two = Store(tmp_path / "one", url), Store(tmp_path / "two", url)
    with one.stage(KEY, resume=True) as slot:
        for step in ("step 1", "step 2"):
            (slot.work / "checkpoint").write_text(step)
            slot.keep_draft(slot.work)
        files, root = fsspec.url_to_fs(url)
        assert not files.exists(f"{root}/objects"), "drafts lie apart from what artifacts share"
    with two.stage(KEY) as slot:
        assert not list(slot.work.iterdir()), "only stages that resume ask for it"
    with two.stage(KEY, resume=True) as slot:
        assert (slot.work / "checkpoint").read_text() == "step 2"
        (slot.work / "a.txt").write_text("result")
        slot.finish()
    assert not files.find(f"{root}/drafts")
    assert (one.fetch(str(KEY)).folder / "a.txt").read_text() == "result"


def test_a_machine_that_has_work_of_its_own_goes_on_with_that(tmp_path: Path, url: str) -> None:
    one, two = Store(tmp_path / "one", url), Store(tmp_path / "two", url)
    for store, step in ((two, "step 1"), (one, "step 2")):
        with store.stage(KEY, resume=True) as slot:
            (slot.work / "checkpoint").write_text(step)
            slot.keep_draft(slot.work)
    with two.stage(KEY, resume=True) as slot:
        assert (slot.work / "checkpoint").read_text() == "step 1"


def test_half_a_draft_is_none(tmp_path: Path, url: str) -> None:
    files, root = fsspec.url_to_fs(url)
    with Store(tmp_path / "one", url).stage(KEY, resume=True) as slot:
        for name in ("checkpoint", "curve"):
            (slot.work / name).write_text(name)
        slot.keep_draft(slot.work)
    (damaged,) = (path for path in files.find(f"{root}/drafts") if files.cat_file(path) == b"curve")
    files.pipe_file(damaged, b"curv")
    with Store(tmp_path / "two", url).stage(KEY, resume=True) as slot:
        assert not list(slot.work.iterdir())


@pytest.mark.parametrize("last", ["manifest", "curve"])
def test_a_write_that_is_cut_off_leaves_the_draft_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: str
) -> None:
    url = f"file://{tmp_path}/shared"
    with Store(tmp_path / "one", url).stage(KEY, resume=True) as slot:
        for name in ("checkpoint", "curve"):
            (slot.work / name).write_text("step 1")
        slot.keep_draft(slot.work)
        (slot.work / "curve").write_text("step 1, step 2")
        disk = fsspec.get_filesystem_class("file")
        with monkeypatch.context() as patch:
            if last == "manifest":  # what a kill leaves of a file: its beginning
                patch.setattr(disk, "pipe_file", lambda _, path, value: cut(path, value))
            else:
                patch.setattr(disk, "put_file", lambda _, a, b: cut(b, Path(a).read_bytes()))
            with pytest.raises(StageError, match="cut off"):
                slot.keep_draft(slot.work)
    with Store(tmp_path / "two", url).stage(KEY, resume=True) as slot:
        assert (slot.work / "curve").read_text() == "step 1"


def cut(path: str, contents: bytes) -> None:
    Path(path).write_bytes(contents[: len(contents) // 2])
    raise OSError("cut off")
