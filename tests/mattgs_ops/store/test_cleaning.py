"""Cleaning removes what nobody refers to, and nothing that anybody uses."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from mattgs_ops.store import lock
from mattgs_ops.store.cleaning import clean, in_use
from mattgs_ops.store.keys import StageKey, stage_key
from mattgs_ops.store.store import Finished, Store

PAST = time.time() - 3600


def key(stage: str, name: str, **inputs: str) -> StageKey:
    return stage_key(stage, "c0de", {"name": name}, inputs)


def make(store: Store, one: StageKey, text: str = "result") -> Finished:
    with store.stage(one) as slot:
        (slot.work / "a.txt").write_text(text)
        return slot.finish()


def age(store: Store) -> None:
    """Make all that is there an hour old."""
    for path in store.root.rglob("*"):
        os.utime(path, (PAST, PAST))


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Return a store with two trainings and a left work folder, an hour old."""
    store = Store(tmp_path / "store")
    make(store, key("train", "kept"), "kept result")
    make(store, key("train", "lost"), "lost")
    with store.stage(key("sfm", "killed"), resume=True) as slot:
        (slot.work / "database").write_bytes(b"0" * 100)
    age(store)
    return store


KEPT, LOST, KILLED = (
    str(key(*p)) for p in (("train", "kept"), ("train", "lost"), ("sfm", "killed"))
)


def names(
    store: Store, *, dry_run: bool = False, kept: tuple[str, ...] = (KEPT,)
) -> dict[str, int]:
    removed = clean(store, kept, unused_since=time.time(), dry_run=dry_run)
    return {one.name: one.size for one in removed if one.kind != "lock"}


def test_what_nobody_refers_to_goes_and_the_rest_stays(store: Store) -> None:
    lost = sum(p.stat().st_size for p in (store.root / LOST).rglob("*") if p.is_file())
    expected = {LOST: lost, f"work/{KILLED.replace('/', '-')}": 100}
    everything = sorted(store.root.rglob("*"))
    assert names(store, dry_run=True) == expected
    assert sorted(store.root.rglob("*")) == everything
    assert names(store) == expected
    assert store.require(KEPT).size == len("kept result")
    assert store.find(LOST) is None
    assert [p.name for p in (store.root / "locks").iterdir()] == [KEPT.replace("/", "-")]
    assert names(store) == {}


def test_files_that_are_no_artifacts_are_left_alone(store: Store) -> None:
    (store.root / "train" / ".DS_Store").write_text("of another system")
    assert LOST in names(store)
    assert (store.root / "train" / ".DS_Store").is_file()


def test_a_dry_run_counts_the_same_locks(store: Store) -> None:
    foretold = clean(store, {KEPT}, unused_since=time.time(), dry_run=True)
    assert clean(store, {KEPT}, unused_since=time.time()) == foretold


def test_what_was_asked_for_lately_can_be_spared(store: Store) -> None:
    with store.stage(key("train", "lost")):
        pass
    removed = clean(store, {KEPT}, unused_since=time.time() - 60)
    assert LOST not in {one.name for one in removed}
    assert store.require(LOST)


def test_a_running_benchmark_keeps_what_it_has_asked_for(store: Store) -> None:
    with in_use(store):
        with store.stage(key("train", "lost")) as slot:
            assert slot.finished is not None
        assert set(names(store)) == {f"work/{KILLED.replace('/', '-')}"}
        assert store.require(LOST)


def test_a_stage_at_work_keeps_its_folder_although_nobody_registered(store: Store) -> None:
    with store.stage(key("sfm", "killed"), resume=True) as slot:
        age(store)
        assert set(names(store)) == {LOST}
        assert (slot.work / "database").is_file()


def test_a_killed_benchmark_keeps_nothing(store: Store) -> None:
    code = f"""
        from pathlib import Path
        from mattgs_ops.store.store import Store
        from mattgs_ops.store.cleaning import in_use
        with in_use(Store(Path({str(store.root)!r}))):
            print("registered", flush=True)
            input()
    """
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-c", textwrap.dedent(code)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment) as child:
        assert child.stdout is not None
        child.stdout.readline()
        age(store)
        assert names(store) == {}, "the benchmark began before all dates"
        child.send_signal(signal.SIGKILL)
    assert LOST in names(store)
    assert not list((store.root / "users").iterdir())


def test_what_kept_results_were_made_of_stays(store: Store) -> None:
    first = make(store, key("sfm", "first"), "first")
    second = make(store, key("agree", "second", scene=first.digest), "second")
    last = make(store, key("train", "last", scene=second.digest), "last")
    age(store)
    assert set(names(store, kept=(last.key,))) >= {LOST, KEPT}
    for one in (first, second, last):
        assert store.require(one.key) == one


def test_measurements_stay_with_what_was_measured(store: Store) -> None:
    of_kept = key("measure", "a", splats=store.require(KEPT).digest)
    of_both = key("measure", "b", one=store.require(KEPT).digest, two=store.require(LOST).digest)
    for one in (of_kept, of_both):
        make(store, one)
    age(store)
    assert set(names(store)) >= {LOST, str(of_both)}
    assert store.require(of_kept)


def test_a_lock_that_is_cleaned_away_is_waited_for_no_longer(store: Store) -> None:
    """One who waits on a lock's file that somebody removes takes the file that is there then."""
    with store.lock(LOST) as mine:
        assert mine
        (store.root / "locks" / LOST.replace("/", "-")).unlink()
        with store.lock(LOST, wait=False) as other:
            assert other, "another file, another lock"
    with store.lock(LOST) as mine:
        assert mine


def test_a_lock_is_worth_nothing_on_a_file_that_is_gone_or_replaced(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with path.open("ab") as file:
        assert lock.is_at(file, path)
        path.unlink()
        assert not lock.is_at(file, path)
        path.touch()
        assert not lock.is_at(file, path)


def test_a_folder_without_a_store_is_clean(tmp_path: Path) -> None:
    assert clean(Store(tmp_path / "nothing"), (), unused_since=time.time()) == []
    assert not (tmp_path / "nothing").exists()
