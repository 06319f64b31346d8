"""A report built from the registry alone is the first one, byte for byte."""

import hashlib
import shutil
from pathlib import Path
from typing import Any

import pytest

from flows.results.rebuild import rebuild_report
from mattgs_ops.errors import InputError
from reports.page.build import build
from tasks.registry import promotion, runs, summary
from tasks.registry.lookup import find_run
from tests.flows.results.conftest import files_of
from tests.reports.conftest import write_ply

pytestmark = pytest.mark.usefixtures("rough_figures")

Row = dict[str, Any]


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "gate" not in path.parts
    }


@pytest.fixture(scope="module")
def out(
    pictured: tuple[list[Row], Path],
    fresh_registry: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return an output folder that holds a benchmark's first report, and nothing but MLflow."""
    folder = tmp_path_factory.mktemp("rebuild")
    shutil.copy(fresh_registry, folder / "mlflow.db")
    shutil.copytree(pictured[1], folder / "store")
    experiment = runs.open_benchmark(uri_of(folder), "toy", folder / "mlflow-artifacts")
    rows = []
    for row in pictured[0]:
        files = files_of(row, folder / "store", folder / "copies" / row["capture"])
        run = runs.record(uri_of(folder), experiment, row, parameters={}, files=files)
        rows.append(row | {"run_id": run})
    first = folder / "first"
    build(rows, first, title="Benchmark toy", artifacts_root=folder / "store")
    summary.record_summary(uri_of(folder), experiment, "toy", rows, first)
    shutil.rmtree(folder / "store")
    return folder


def uri_of(folder: Path) -> str:
    return f"sqlite:///{folder / 'mlflow.db'}"


def client_of(folder: Path) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=uri_of(folder))


def test_the_registry_alone_gives_the_same_bytes(out: Path) -> None:
    again = rebuild_report("toy", out).parent
    first, second = digests(out / "first"), digests(again)
    assert first.keys() == second.keys()
    assert len(first) > 20
    assert [name for name in first if first[name] != second[name]] == []
    text = (again / "report.md").read_text(encoding="utf-8")
    assert "Outlines of the masks, all photos;" in text, "though the photos are gone"
    assert "Flags: frame (1): 0001.jpg." in text


def test_there_is_one_summary_with_the_report_in_it(out: Path) -> None:
    experiment = runs.open_benchmark(uri_of(out), "toy", None)
    rows = summary.report_rows(uri_of(out), "toy")
    summary.record_summary(uri_of(out), experiment, "toy", rows, out / "first")
    client = client_of(out)
    (found,) = client.search_runs([experiment], filter_string="tags.`mattgs.summary` = 'toy'")
    assert found.data.metrics["finished"] == len(rows)
    names = {file.path for file in client.list_artifacts(found.info.run_id, "report")}
    assert {"report/report.html", "report/tables", "report/figures"} <= names


def test_experiments_that_the_newest_run_did_not_have_are_counted(out: Path) -> None:
    experiment = runs.open_benchmark(uri_of(out), "part", out / "mlflow-artifacts")
    row = summary.report_rows(uri_of(out), "toy")[0]
    bare = row | {"benchmark": "part", "artifacts": {}, "run_id": None}
    both = [bare, bare | {"iterations": 9}]
    ids = [runs.record(uri_of(out), experiment, one, parameters={}) for one in both]
    known = [one | {"run_id": run} for one, run in zip(both, ids, strict=True)]
    summary.record_summary(uri_of(out), experiment, "part", known, out / "first/tables")
    assert "left out" not in rebuild_report("part", out).read_text(encoding="utf-8")
    summary.record_summary(uri_of(out), experiment, "part", known[:1], out / "first/tables")
    text = (rebuild_report("part", out).parent / "report.md").read_text(encoding="utf-8")
    assert "1 recorded experiment is left out: the newest run of the benchmark did not" in text


def test_a_run_that_ended_after_the_summary_is_not_left_out(out: Path) -> None:
    experiment = runs.open_benchmark(uri_of(out), "late", out / "mlflow-artifacts")
    row = summary.report_rows(uri_of(out), "toy")[0]
    bare = row | {"benchmark": "late", "artifacts": {}, "run_id": None}
    run = runs.record(uri_of(out), experiment, bare, parameters={})
    known = [bare | {"run_id": run}]
    summary.record_summary(uri_of(out), experiment, "late", known, out / "first/tables")
    assert summary.report_rows(uri_of(out), "late") == known
    runs.record(uri_of(out), experiment, bare | {"seed": 7}, parameters={})
    seeds = [row["seed"] for row in summary.report_rows(uri_of(out), "late")]
    assert sorted(seeds) == [0, 7]


def test_a_benchmark_without_runs_is_refused(out: Path) -> None:
    with pytest.raises(InputError, match=r"no benchmark is called 'nobody'; known: .*toy"):
        summary.report_rows(uri_of(out), "nobody")
    runs.open_benchmark(uri_of(out), "empty", out / "mlflow-artifacts")
    with pytest.raises(InputError, match="'empty' has no recorded experiment"):
        summary.report_rows(uri_of(out), "empty")


def test_a_promotion_shows_in_the_report_that_is_built_next(out: Path, tmp_path: Path) -> None:
    """The run keeps its splats alone: of pictures the report says nothing else."""
    experiment = runs.open_benchmark(uri_of(out), "promoted", out / "mlflow-artifacts")
    rows = summary.report_rows(uri_of(out), "toy")
    row = next(row for row in rows if row["condition"] == "nobg-ours")
    bare = row | {"benchmark": "promoted", "artifacts": {}, "run_id": None}
    (tmp_path / "training.json").write_text('{"background": [1, 1, 1]}')
    write_ply(tmp_path / "splats.ply", row["capture"], 20, seed=0)
    kept = [(tmp_path / name, "") for name in ("splats.ply", "training.json")]
    run = runs.record(uri_of(out), experiment, bare, parameters={}, files=kept)
    known = [bare | {"run_id": run}]
    summary.record_summary(uri_of(out), experiment, "promoted", known, out / "first/tables")
    promotion.promote(uri_of(out), find_run(uri_of(out), run))
    text = rebuild_report("promoted", out).read_text("utf-8")
    assert "Against the promoted baseline" in text
    assert "Ours ★" in text
