"""``mattgs clean``: runs in MLflow and rows on disk both hold on to their artifacts."""

import json
import os
import time
from pathlib import Path
from typing import Any

import pytest

from flows import run_record
from flows.clean import clean_up, referred, size
from flows.services import registries
from mattgs_ops.errors import InputError
from mattgs_ops.store.keys import stage_key
from mattgs_ops.store.store import Store
from tasks.registry import runs
from tasks.stages.status import StatusFile


def put(out: Path, name: str) -> str:
    """Put an hour-old artifact into the store and return its reference, as rows hold it."""
    key = stage_key("train", "c0de", {"name": name}, {})
    with Store(out / "store").stage(key) as slot:
        (slot.work / "splats.ply").write_bytes(b"0" * 1000)
        slot.finish()
    past = time.time() - 3600
    for path in (out / "store").rglob("*"):
        os.utime(path, (past, past))
    return f"{key}/files"


def row(seed: int, reference: str) -> dict[str, Any]:
    cell = {"benchmark": "b", "capture": "rover", "condition": "nobg-3dgs", "seed": seed}
    grid = {"background": "nobg", "method": "3dgs", "iterations": 1, "resolution": 64}
    rest = {"schema": 1, "status": "failed", "reason": "x", "artifacts": {"train": reference}}
    return cell | grid | rest


def test_runs_and_rows_hold_on_to_their_artifacts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    in_rows, in_mlflow, lost = (put(tmp_path, name) for name in ("rows", "mlflow", "lost"))
    (tmp_path / "benchmarks" / "b").mkdir(parents=True)
    text = json.dumps([row(0, in_rows)])
    (tmp_path / "benchmarks" / "b" / "rows.json").write_text(text)
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    runs.initialise(uri)
    experiment = runs.open_benchmark(uri, "b", tmp_path / "mlflow-artifacts")
    runs.record(uri, experiment, row(1, in_mlflow), parameters={})
    runs.begin(uri, experiment, row(2, "nothing yet"), {})  # at work, or killed

    told = clean_up(tmp_path, unused_hours=0, dry_run=True)
    assert "Would remove 1 artifact, 0 work folders, 1 lock: 1.4 kB" in told
    assert lost.removesuffix("/files") in told
    assert clean_up(tmp_path, unused_hours=2, dry_run=False).startswith("Removed 0 artifacts")
    assert (tmp_path / "store" / lost).is_dir()

    assert "Removed 1 artifact, 0 work folders, 1 lock" in clean_up(
        tmp_path, unused_hours=0, dry_run=False
    )
    left = {str(p.relative_to(tmp_path / "store")) for p in tmp_path.glob("store/train/*/files")}
    assert left == {in_rows, in_mlflow}


def test_an_interrupted_run_keeps_what_it_finished_until_it_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    made = put(tmp_path, "made")
    folder = tmp_path / "benchmarks" / "b"
    for again in range(2):  # interrupted again before it came to this stage
        record = run_record.begin(folder)
        file = StatusFile(tmp_path / "status" / "b" / "sfm.json")
        file.plan("sfm rover", "sfm")
        if not again:
            file.begin("sfm rover", "sfm", made.removesuffix("/files"))
            file.end("done")
        run_record.end(folder, record, "KeyboardInterrupt")
    assert clean_up(tmp_path, unused_hours=0, dry_run=False).startswith("Removed 0 artifacts")
    (folder / "rows.json").write_text("[]")
    run_record.end(folder, record)
    assert "Removed 1 artifact," in clean_up(tmp_path, unused_hours=0, dry_run=False)


def test_a_folder_without_a_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a store"):
        clean_up(tmp_path, unused_hours=0, dry_run=True)


def test_sizes_are_written_for_people() -> None:
    assert [size(n) for n in (0, 999, 1500, 2 * 10**9)] == [
        "0 bytes",
        "999 bytes",
        "1.5 kB",
        "2.0 GB",
    ]


def test_every_registry_of_a_folder_is_asked_whatever_is_set_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    elsewhere = f"sqlite:///{tmp_path / 'elsewhere.db'}"
    kept = {}
    for name, uri in (("own", registries.own(out)), ("elsewhere", elsewhere)):
        kept[name] = put(out, name).removesuffix("/files")
        runs.initialise(uri)
        experiment = runs.open_benchmark(uri, "b", tmp_path / name)
        runs.record(uri, experiment, row(0, f"{kept[name]}/files"), parameters={})
    monkeypatch.setenv("MLFLOW_TRACKING_URI", elsewhere)
    registries.note(out)  # as `mattgs run` does
    registries.note(out)
    assert (out / registries.FILE).read_text() == f"{elsewhere}\n"
    assert referred(out) == set(kept.values())
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    assert referred(out) == set(kept.values())
    (tmp_path / "elsewhere.db").unlink()
    with pytest.raises(InputError, match=r"elsewhere\.db: runs of .* and it is gone; restore it"):
        referred(out)


def test_a_registry_that_does_not_answer_is_named_and_nothing_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "recorded there")
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    registries.note(tmp_path)
    for _ in ("while it is set", "and later"):
        with pytest.raises(InputError, match=r"MLflow at http://127\.0\.0\.1:9 cannot be read"):
            clean_up(tmp_path, unused_hours=0, dry_run=False)
        monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    assert list(tmp_path.glob("store/train/*/files"))


def test_a_file_is_noted_for_any_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "me@home").mkdir()
    (tmp_path / "me@home" / "mine.db").touch()
    monkeypatch.chdir(tmp_path / "me@home")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///mine.db")
    registries.note(tmp_path)
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    monkeypatch.chdir(tmp_path)
    assert registries.everyone(tmp_path) == [f"sqlite:///{tmp_path / 'me@home' / 'mine.db'}"]


def test_a_server_is_noted_without_its_password(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "https://me:secret@mlflow.lab/x")
    registries.note(tmp_path)
    assert (tmp_path / registries.FILE).read_text() == "https://mlflow.lab/x\n"
    assert registries.everyone(tmp_path) == ["https://me:secret@mlflow.lab/x"]
