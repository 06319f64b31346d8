"""The store under what happens to it: repeats, races, kills and damage."""

import hashlib
import json
import logging
import os
import re
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.store.keys import stage_key
from mattgs_ops.store.store import Store

KEY = stage_key("train", "c0de", {"steps": 3}, {"scene": "aa"})


def make(store: Store, text: str = "result", **extra: Any) -> Path:
    with store.stage(KEY) as slot:
        (slot.work / "sub").mkdir()
        (slot.work / "a.txt").write_text(text)
        (slot.work / "sub" / "b.txt").write_text("more")
        return slot.finish(extra).folder


# ------------------------------------------------------------------------------------- keys


def test_keys_see_every_part_and_no_order() -> None:
    base: dict[str, Any] = {"stage": "train", "code_version": "c"}
    base |= {"params": {"a": 1, "b": 2}, "inputs": {"x": "y"}}
    changes: list[dict[str, Any]] = [
        {"stage": "sfm"},
        {"code_version": "d"},
        {"params": {"a": 1, "b": 3}},
        {"inputs": {"x": "z"}},
        {"inputs": {"w": "y"}},
    ]
    keys = [stage_key(**base)] + [stage_key(**base | change) for change in changes]
    assert len({str(key) for key in keys}) == len(keys)
    assert str(stage_key(**base | {"params": {"b": 2, "a": 1}})) == str(keys[0])


def test_configuration_objects_are_parameters() -> None:
    one, two = SfmConfig(), SfmConfig(seed=1)
    assert str(stage_key("sfm", "c", one, {})) == str(stage_key("sfm", "c", SfmConfig(), {}))
    assert str(stage_key("sfm", "c", one, {})) != str(stage_key("sfm", "c", two, {}))


def test_keys_are_the_same_tomorrow() -> None:
    """A changed digest would throw away every stored result: change it on purpose only."""
    text = '{"code_version":"c0de","inputs":{"scene":"aa"},"params":{"steps":3},"stage":"train"}'
    assert str(KEY) == f"train/{hashlib.sha256(text.encode()).hexdigest()[:32]}"


def test_what_cannot_be_a_key_is_refused() -> None:
    with pytest.raises(TypeError):
        stage_key("sfm", "c", {"photos": Path("x")}, {})
    with pytest.raises(InputError, match="expected letters"):
        stage_key("../sfm", "c", {}, {})


# ------------------------------------------------------------------------------- done once


def test_a_finished_stage_is_found_with_all_that_was_stored(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.find(KEY) is None
    folder = make(store, seconds=1.5)
    assert folder == store.folder(KEY) == tmp_path / str(KEY) / "files"
    with Store(tmp_path).stage(KEY) as slot:
        found = slot.finished
        assert found is not None
        assert found == store.require(str(KEY))
        assert (found.folder / "sub" / "b.txt").read_text() == "more"
        assert found.extra == {"seconds": 1.5}
        assert found.size == len("result" + "more")
        with pytest.raises(StageError, match="already finished"):
            slot.finish()


def test_the_manifest_tells_what_the_key_was_made_of(tmp_path: Path) -> None:
    make(Store(tmp_path))
    manifest = json.loads((tmp_path / str(KEY) / "manifest.json").read_text())
    assert {name: manifest[name] for name in KEY.parts()} == KEY.parts()
    assert manifest["files"]["sub/b.txt"]["bytes"] == 4
    assert manifest["created"].endswith("+00:00")


def test_equal_results_have_equal_digests_under_any_key(tmp_path: Path) -> None:
    one, two = Store(tmp_path / "1"), Store(tmp_path / "2")
    make(one, seconds=1.0)
    make(two, seconds=9.0)
    assert one.require(KEY).digest == two.require(KEY).digest
    make(other := Store(tmp_path / "3"), text="another")
    assert other.require(KEY).digest != one.require(KEY).digest


def test_an_empty_result_is_refused(tmp_path: Path) -> None:
    with Store(tmp_path).stage(KEY) as slot, pytest.raises(StageError, match="produced no files"):
        slot.finish()
    assert Store(tmp_path).find(KEY) is None


def test_what_json_cannot_hold_enters_no_manifest(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        make(Store(tmp_path), loss=float("nan"))
    assert Store(tmp_path).find(KEY) is None


def test_require_names_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(StageError, match=re.escape(str(KEY))):
        Store(tmp_path).require(KEY)


# ------------------------------------------------------------------- errors, kills, resuming


def test_nothing_is_stored_when_the_stage_fails(tmp_path: Path) -> None:
    store = Store(tmp_path)

    def fail() -> None:
        with store.stage(KEY) as slot:
            (slot.work / "half").write_text("x")
            raise RuntimeError("broke")

    with pytest.raises(RuntimeError, match="broke"):
        fail()
    assert store.find(KEY) is None
    with store.stage(KEY) as slot:
        assert slot.finished is None
        assert list(slot.work.iterdir()) == []  # starts afresh


def test_work_is_handed_on_to_resume(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with store.stage(KEY, resume=True) as slot:
        (slot.work / "checkpoint").write_text("step 2")
    with store.stage(KEY, resume=True) as slot:
        assert (slot.work / "checkpoint").read_text() == "step 2"
        assert slot.finish().folder == store.folder(KEY)
    assert not list((tmp_path / "work").iterdir())


def process(root: Path, body: str) -> "subprocess.Popen[str]":
    """Start Python code that knows ``store`` and ``key`` and may talk by printing lines."""
    given = (KEY.stage, KEY.code_version, dict(KEY.params), dict(KEY.inputs))
    code = f"""
        import sys
        from pathlib import Path
        from mattgs_ops.store.keys import stage_key
        from mattgs_ops.store.store import Store
        store, key = Store(Path({str(root)!r})), stage_key(*{given!r})
    """
    text = textwrap.dedent(code) + textwrap.dedent(body)
    return subprocess.Popen(
        [sys.executable, "-c", text],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )


HALF_WAY = """
    with store.stage(key, resume=True) as slot:
        (slot.work / "checkpoint").write_text("step 7")
        print("working", flush=True)
        sys.stdin.readline()
        (slot.work / "a.txt").write_text("of the child")
        slot.finish()
        print("finished", flush=True)
"""


def line(child: "subprocess.Popen[str]") -> str:
    assert child.stdout is not None
    return child.stdout.readline().strip()


def test_a_killed_owner_frees_the_lock_and_leaves_its_work(tmp_path: Path) -> None:
    with process(tmp_path, HALF_WAY) as child:
        assert line(child) == "working"
        child.send_signal(signal.SIGKILL)
        child.wait()
    store = Store(tmp_path)
    assert store.find(KEY) is None
    with store.stage(KEY, resume=True) as slot:  # would wait forever if the lock were still held
        assert (slot.work / "checkpoint").read_text() == "step 7"


def test_two_processes_do_a_stage_once(tmp_path: Path) -> None:
    waiter = """
        print("started", flush=True)
        with store.stage(key) as slot:
            print((slot.finished.folder / "a.txt").read_text() if slot.finished else "empty",
                  flush=True)
    """
    with process(tmp_path, HALF_WAY) as first:
        assert line(first) == "working"
        with process(tmp_path, waiter) as second:
            assert line(second) == "started"
            with pytest.raises(subprocess.TimeoutExpired):
                second.wait(timeout=0.3)
            assert first.stdin is not None
            first.stdin.write("\n")
            first.stdin.flush()
            assert line(first) == "finished"
            assert line(second) == "of the child"


def test_a_kill_just_before_the_result_moves_into_place(tmp_path: Path) -> None:
    """The manifest is written, the rename is not: nothing is there, and the next one can finish."""
    body = """
        def kill(self, target):
            import os, signal
            os.kill(os.getpid(), signal.SIGKILL)
        Path.rename = kill
        with store.stage(key) as slot:
            (slot.work / "a.txt").write_text("x")
            slot.finish()
    """
    with process(tmp_path, body) as child:
        assert child.wait() == -signal.SIGKILL
    store = Store(tmp_path)
    assert (tmp_path / "work" / str(KEY).replace("/", "-") / "manifest.json").is_file()
    assert store.find(KEY) is None
    make(store)
    assert store.require(KEY)


# ----------------------------------------------------------------------------------- damage


def damage(place: Path, kind: str) -> None:
    target = place / "files" / "a.txt"
    if kind == "cut short":
        target.write_text("res")
    elif kind == "same size":
        target.write_text("rEsult")
    elif kind == "missing":
        target.unlink()
    elif kind == "extra":
        (place / "files" / "new").write_text("x")
    elif kind == "no manifest":
        (place / "manifest.json").unlink()
    else:
        (place / "manifest.json").write_text('{"files": ')


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("cut short", "a.txt has 3 bytes instead of 6"),
        ("same size", "a.txt has other contents"),
        ("missing", "a.txt is missing"),
        ("extra", "new is not expected"),
        ("no manifest", "unreadable manifest"),
        ("bad manifest", "unreadable manifest"),
    ],
)
def test_damage_is_seen_said_and_repaired(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: str, message: str
) -> None:
    store = Store(tmp_path)
    make(store)
    damage(tmp_path / str(KEY), kind)
    with caplog.at_level(logging.WARNING):
        assert store.find(KEY) is None
    assert message in caplog.text
    assert "it will be made again" in caplog.text
    make(store)
    assert (store.require(KEY).folder / "a.txt").read_text() == "result"


def test_sizes_alone_can_be_asked_for(tmp_path: Path) -> None:
    store = Store(tmp_path)
    make(store)
    damage(tmp_path / str(KEY), "same size")
    assert store.find(KEY, contents=False) is not None


def test_links_do_not_enter_the_store(tmp_path: Path) -> None:
    with Store(tmp_path).stage(KEY) as slot:
        (slot.work / "link").symlink_to("/etc/hostname")
        with pytest.raises(InputError, match="link"):
            slot.finish()
