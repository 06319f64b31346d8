"""A folder that was moved or copied works on its own files, and on no others."""

import json
import os
import shutil
from pathlib import Path

import pytest

from mattgs_ops.store.cleaning import in_use
from mattgs_ops.store.store import Store
from tasks.registry import runs, summary
from tasks.registry.upkeep.moved import ARTIFACTS, DATABASE, correct_places

ROW = {
    "schema": 1,
    "benchmark": "b",
    "capture": "rover",
    "condition": "nobg-3dgs",
    "seed": 0,
    "background": "nobg",
    "method": "3dgs",
    "iterations": 1,
    "resolution": 64,
    "status": "failed",
    "reason": "x",
    "artifacts": {},
    "metrics": {},
}


def uri(out: Path) -> str:
    return f"sqlite:///{out / DATABASE}"


def summarise(out: Path) -> None:
    """Record a run and a summary; a summary that was there is replaced."""
    experiment = runs.open_benchmark(uri(out), "b", out / ARTIFACTS)
    runs.record(uri(out), experiment, ROW, parameters={})
    report = out / "report"
    report.mkdir(exist_ok=True)
    (report / "report.md").write_text("# b")
    summary.record_summary(uri(out), experiment, "b", [ROW], report)


def begun(registry: Path, out: Path) -> Path:
    """Make an output folder with a copy of an empty registry, and record into it."""
    out.mkdir()
    shutil.copy(registry, out / DATABASE)
    summarise(out)
    return out


@pytest.fixture
def original(fresh_registry: Path, tmp_path: Path) -> Path:
    return begun(fresh_registry, tmp_path / "my first out")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_copy_leaves_the_original_alone(original: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(original, copy)
    before = contents(original)
    assert correct_places(copy)
    assert not correct_places(copy), "once is enough"
    summarise(copy)
    assert len(summary.purge(uri(copy))) == 1
    assert contents(original / ARTIFACTS) == {
        name.removeprefix(f"{ARTIFACTS}{os.sep}"): data
        for name, data in before.items()
        if name.startswith(ARTIFACTS)
    }
    assert not correct_places(original)
    for out in (original, copy):
        (row,) = summary.report_rows(uri(out), "b")
        assert json.loads(json.dumps(row))["capture"] == "rover"


def test_a_folder_that_was_moved_works_where_it_is(original: Path, tmp_path: Path) -> None:
    moved = original.rename(tmp_path / "moved")
    assert correct_places(moved)
    summarise(moved)
    assert len(summary.report_rows(uri(moved), "b")) == 1
    assert not original.exists()


def test_a_copy_with_a_project_names_its_own_files(
    fresh_registry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MATTGS_PROJECT", "anna")  # whose folder is one more level
    out = begun(fresh_registry, tmp_path / "out")
    copy = tmp_path / "copy"
    shutil.copytree(out, copy)
    assert correct_places(copy)
    (run,) = runs.rows(uri(copy), "b")
    assert summary.run_files(uri(copy), run["run_id"], tmp_path).is_relative_to(copy)


def test_files_of_another_folder_that_shares_the_database_stay_where_they_are(
    original: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other"
    experiment = runs.open_benchmark(uri(original), "of-other", other / ARTIFACTS)
    runs.record(uri(original), experiment, ROW | {"benchmark": "of-other"}, parameters={})
    assert not correct_places(original)
    assert len(runs.rows(uri(original), "of-other")) == 1


def test_while_a_benchmark_runs_nothing_is_corrected(original: Path, tmp_path: Path) -> None:
    """It may run in a container, which calls the folder otherwise."""
    moved = original.rename(tmp_path / "moved")
    with in_use(Store(moved / "store")):
        assert not correct_places(moved)
    assert correct_places(moved)


def test_what_is_no_registry_is_left_to_mlflow(tmp_path: Path) -> None:
    assert not correct_places(tmp_path)
    (tmp_path / ARTIFACTS).mkdir()
    (tmp_path / DATABASE).write_text("no database, and longer than a header of one may be" * 9)
    assert not correct_places(tmp_path)
