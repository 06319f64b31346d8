"""A store that machines share: whole or not at all, verified on the way down, first one stays."""

import hashlib
import json
import logging
import shutil
from pathlib import Path

import fsspec
import pytest

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.store.keys import stage_key
from mattgs_ops.store.remote import RemoteStore
from mattgs_ops.store.store import Finished, Store

KEY = stage_key("train", "c0de", {"steps": 3}, {"scene": "aa"})


def make(store: Store, text: str = "result") -> Finished:
    with store.stage(KEY) as slot:
        assert slot.finished is None
        (slot.work / "sub").mkdir()
        (slot.work / "a.txt").write_text(text)
        (slot.work / "sub" / "b.txt").write_text("more")
        return slot.finish({"seconds": 1.0})


def objects(url: str) -> list[str]:
    files, root = fsspec.url_to_fs(url)
    return sorted(str(path) for path in files.ls(f"{root}/objects", detail=False))


def test_what_one_machine_finishes_another_finds(tmp_path: Path, url: str) -> None:
    made = make(Store(tmp_path / "one", url))
    other = Store(tmp_path / "two", url)
    with other.stage(KEY) as slot:
        assert slot.finished is not None
        assert (slot.finished.digest, slot.finished.extra) == (made.digest, {"seconds": 1.0})
    shutil.rmtree(tmp_path / "one")
    assert (other.fetch(str(KEY)).folder / "sub" / "b.txt").read_text() == "more"
    assert Store(tmp_path / "two").require(KEY).digest == made.digest


def test_what_is_nowhere_is_said_so(tmp_path: Path, url: str) -> None:
    with pytest.raises(StageError, match="expected a finished stage"):
        Store(tmp_path / "one", url).fetch(str(KEY))


def test_without_its_manifest_an_artifact_is_not_there(tmp_path: Path, url: str) -> None:
    """The manifest is written last: a kill before that leaves objects that nobody reads."""
    make(Store(tmp_path / "one", url))
    files, root = fsspec.url_to_fs(url)
    files.rm_file(f"{root}/{KEY}/manifest.json")
    assert len(objects(url)) == 2
    make(Store(tmp_path / "two", url))


def test_half_a_manifest_counts_for_none(tmp_path: Path, url: str) -> None:
    make(Store(tmp_path / "one", url))
    files, root = fsspec.url_to_fs(url)
    files.pipe_file(f"{root}/{KEY}/manifest.json", b'{"files": ')
    made = make(Store(tmp_path / "two", url))
    assert Store(tmp_path / "three", url).fetch(str(KEY)).digest == made.digest


@pytest.mark.parametrize("contents", [b"rEsult", b"res", b""])
def test_a_damaged_object_is_seen_said_and_repaired(
    tmp_path: Path, url: str, caplog: pytest.LogCaptureFixture, contents: bytes
) -> None:
    make(Store(tmp_path / "one", url))
    files, _ = fsspec.url_to_fs(url)
    damaged = next(path for path in objects(url) if files.cat_file(path) == b"result")
    files.pipe_file(damaged, contents)
    two = Store(tmp_path / "two", url)
    with caplog.at_level(logging.WARNING):
        make(two)  # finds none, makes it again
    assert "damaged; it will be made again" in caplog.text
    assert (Store(tmp_path / "three", url).fetch(str(KEY)).folder / "a.txt").read_text() == "result"


def test_of_two_machines_that_finish_at_once_the_first_is_everybodys(
    tmp_path: Path, url: str
) -> None:
    one, two = Store(tmp_path / "one", url), Store(tmp_path / "two", url)
    with two.stage(KEY) as slot:
        first = make(one, "of one")
        (slot.work / "a.txt").write_text("of two")
        second = slot.finish({"seconds": 2.0})
    assert second.digest == first.digest
    assert (second.folder / "a.txt").read_text() == "of one"
    assert not list((tmp_path / "two" / "work").iterdir())


def test_what_was_finished_but_not_shared_is_shared_when_asked_for(
    tmp_path: Path, url: str
) -> None:
    """A kill between the local result and its upload loses nothing."""
    made = make(Store(tmp_path / "one"))
    with Store(tmp_path / "one", url).stage(KEY) as slot:
        assert slot.finished is not None
    assert Store(tmp_path / "two", url).fetch(str(KEY)).digest == made.digest


def test_a_download_leaves_an_interrupted_stage_nothing(tmp_path: Path, url: str) -> None:
    store = Store(tmp_path / "one", url)
    with store.stage(KEY, resume=True) as slot:
        (slot.work / "checkpoint").write_text("step 2")
    with store.stage(KEY, resume=True) as slot:
        assert (slot.work / "checkpoint").read_text() == "step 2", "nobody else has it: go on"
    make(Store(tmp_path / "two", url))
    store.fetch(str(KEY))
    assert not list((tmp_path / "one" / "work").iterdir())


def test_one_machine_brings_several_results_of_a_stage(tmp_path: Path, url: str) -> None:
    keys = [stage_key("train", "c0de", {"steps": steps}, {}) for steps in (1, 2)]
    for key in keys:
        with Store(tmp_path / "one", url).stage(key) as slot:
            (slot.work / "a.txt").write_text(str(key))
            slot.finish()
    two = Store(tmp_path / "two", url)
    for key in keys:
        assert (two.fetch(key).folder / "a.txt").read_text() == str(key)


def test_what_a_kill_left_beside_the_work_is_no_part_of_the_result(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with store.stage(KEY, resume=True) as slot:
        (slot.work / "a.txt").write_text("result")
        (slot.work.parent / "manifest.json").write_text('{"files": ')
        (slot.work.parent / "coming" / "sub").mkdir(parents=True)
    with store.stage(KEY, resume=True) as slot:
        slot.finish()
    assert sorted(path.name for path in (tmp_path / str(KEY)).iterdir()) == [
        "files",
        "manifest.json",
    ]
    assert (store.require(KEY).folder / "a.txt").read_text() == "result"


EVIL = b"from somebody else"
ATTACKS = ("../../../../evil.txt", "{outside}/evil.txt", "sub/../../../evil.txt")  # names of files


def plant(url: str, place: str, files: dict[str, object]) -> None:
    """Write a manifest as somebody would who can write to the shared store, and its object."""
    shared, root = fsspec.url_to_fs(url)
    digest = hashlib.sha256(EVIL).hexdigest()
    for folder in ("objects", place):
        shared.makedirs(f"{root}/{folder}", exist_ok=True)
        shared.pipe_file(f"{root}/{folder}/{digest}", EVIL)
    text = json.dumps({"digest": "d", "extra": {"seconds": 1.0}, "files": files})
    shared.pipe_file(f"{root}/{place}/manifest.json", text.encode())


@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize("place", [str(KEY), f"drafts/{KEY}"])
def test_a_planted_manifest_writes_nothing_outside_its_artifact(
    tmp_path: Path, url: str, place: str, attack: str
) -> None:
    name = attack.format(outside=tmp_path)
    row = {"bytes": len(EVIL), "sha256": hashlib.sha256(EVIL).hexdigest()}
    plant(url, place, {name: row})
    victim = Store(tmp_path / "deep" / "deeper" / "victim", url)
    says = f"{place}/manifest.json: `files`: expected a path below its folder.*, found {name!r}"
    with pytest.raises(InputError, match=says), victim.stage(KEY, resume=True):
        pass
    assert not list(tmp_path.rglob("*evil*"))


@pytest.mark.parametrize("digest", ["../../precious.txt", "", None, "ab" * 31, "AB" * 32])
def test_a_planted_digest_neither_reads_nor_removes_another_file(
    tmp_path: Path, url: str, digest: str | None
) -> None:
    """An object that differs from its digest is removed: the digest must not name anything else."""
    shared, root = fsspec.url_to_fs(url)
    plant(url, str(KEY), {"a.txt": {"bytes": 3, "sha256": digest}})
    precious = f"{root}/precious.txt"
    shared.pipe_file(precious, b"precious")
    with pytest.raises(InputError, match=r"`files.a.txt.sha256`: expected 64 hexadecimal digits"):
        Store(tmp_path / "victim", url).fetch(str(KEY))
    assert shared.cat_file(precious) == b"precious"
    assert not list((tmp_path / "victim").rglob("a.txt"))


def test_a_planted_draft_removes_nothing_when_the_next_one_comes(tmp_path: Path, url: str) -> None:
    shared, root = fsspec.url_to_fs(url)
    plant(url, f"drafts/{KEY}", {"checkpoint": {"bytes": 3, "sha256": "../../../precious.txt"}})
    shared.pipe_file(f"{root}/precious.txt", b"precious")
    with Store(tmp_path / "one", url).stage(KEY) as slot:
        (slot.work / "checkpoint").write_text("step 1")
        with pytest.raises(InputError, match=r"drafts/.*expected 64 hexadecimal digits"):
            slot.keep_draft(slot.work)
    assert shared.cat_file(f"{root}/precious.txt") == b"precious"


@pytest.mark.parametrize("files", [["a.txt"], "a.txt", {"a.txt": "abc"}])
def test_a_manifest_of_another_shape_is_refused(tmp_path: Path, url: str, files: object) -> None:
    shared, root = fsspec.url_to_fs(url)
    shared.makedirs(f"{root}/{KEY}", exist_ok=True)
    shared.pipe_file(f"{root}/{KEY}/manifest.json", json.dumps({"files": files}).encode())
    with pytest.raises(InputError, match=r"manifest.json: `files"):
        Store(tmp_path / "one", url).fetch(str(KEY))


def test_a_bucket_that_is_not_there_is_refused_and_not_made(s3: str) -> None:
    assert s3
    with pytest.raises(InputError, match=r"--store s3://mistyped/shared: cannot be written"):
        RemoteStore("s3://mistyped/shared").check()
    assert not fsspec.filesystem("s3", use_listings_cache=False).exists("mistyped")


def test_a_place_that_cannot_be_used_is_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--store nothing://x"):
        RemoteStore("nothing://x")
    for nowhere in ("", "/"):  # such as a variable that is not set
        with pytest.raises(InputError, match=f"--store '{nowhere}': expected a URL"):
            RemoteStore(nowhere)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        RemoteStore(f"file://{tmp_path}/file/store").check()
    RemoteStore(f"file://{tmp_path}/new/store").check()
