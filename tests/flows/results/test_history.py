"""``mattgs history`` on a real registry: steps with their first commit, and the gate's verdicts."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flows.cli.app import app
from flows.gate import judge
from reports.gate import baseline
from reports.gate.planted import grow, lose_quality
from tasks.registry import runs
from tasks.registry.content import history

Row = dict[str, Any]
COMMITS, LOST_AT, GROWN_AT = 7, 4, 2
SEEDS = 3
CONDITION = "nobg-ours+"


def at_commit(row: Row, place: int) -> Row:
    """Return the row as code at a commit gives it: a loss from one on, growth from another."""
    row = lose_quality(row, 0.5) if place >= LOST_AT else row
    views = [view["psnr"] for view in row["per_view"] if view["split"] == "test"]
    row = row | {"metrics": row["metrics"] | {"psnr": sum(views) / len(views)}}
    row = grow(row, 0.2) if place >= GROWN_AT else row
    origin = {"git": f"c{place}" + "0" * 38, "code_version": f"code {place}"}
    return row | {"provenance": row["provenance"] | origin}


@pytest.fixture(scope="module")
def out(fresh_registry: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a registry of seven commits, the newest rows beside it."""
    folder = tmp_path_factory.mktemp("history")
    shutil.copy(fresh_registry, folder / "mlflow.db")
    uri = f"sqlite:///{folder / 'mlflow.db'}"
    experiment = runs.open_benchmark(uri, "quick-ci", folder / "artifacts")
    cell = [row for row in baseline.load("quick-ci").rows if row["condition"] == CONDITION]
    known = [row for row in cell if row["seed"] < SEEDS]
    rows: list[Row] = []
    for place in range(COMMITS):
        rows = [at_commit(row, place) for row in known]
        rows = [r | {"run_id": runs.record(uri, experiment, r, parameters={})} for r in rows]
    baseline.make(known, "before").save(folder / "before.json")
    benchmark = folder / "benchmarks" / "quick-ci"
    benchmark.mkdir(parents=True)
    (benchmark / "rows.json").write_text(json.dumps(rows))
    return folder


def test_steps_are_named_and_verdicts_are_marked(out: Path) -> None:
    text, code = judge(out, "quick-ci", str(out / "before.json"))
    assert code == 1, text
    done = CliRunner().invoke(app, ["history", "quick-ci", "--out", str(out)])
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0] == "History of quick-ci: 21 runs of 1 cell on 7 commits; 3 steps."
    steps = {line.split("  ")[-1].split(":")[0]: line for line in lines if "first at" in line}
    assert steps.keys() == {"PSNR", "Size(MB)", "Splats"}
    assert all(line.startswith("worse") for line in steps.values())
    assert "first at c4000000, last before c3000000" in steps["PSNR"]
    assert "first at c2000000, last before c1000000" in steps["Size(MB)"]
    page = (out / "benchmarks" / "quick-ci" / "history" / "history.html").read_text("utf-8")
    marked = [part for part in page.split("<title>") if "gate: worse than before" in part]
    assert marked, "the gate's verdicts are marks"
    assert all(part.partition("</title>")[0].count("c6000000") for part in marked)


def test_the_registry_returns_what_it_holds(out: Path) -> None:
    found = history.runs_of(f"sqlite:///{out / 'mlflow.db'}", "quick-ci")
    assert [run["git"][:2] for run in found] == [f"c{i // SEEDS}" for i in range(SEEDS * COMMITS)]
    assert [run["seed"] for run in found[:3]] == [0, 1, 2]
    one = found[0]
    assert one["metrics"]["registered"] > 0
    assert one["metrics"]["time_calibrated"] > 0
    assert "cpu_kind" in one["timed_on"]
    assert "cpu_kind" in one["measured_on"]
    assert not any(name.startswith("curve_") for name in one["metrics"])


def test_verdicts_that_cannot_be_kept_cost_a_warning_only(
    out: Path, caplog: pytest.LogCaptureFixture
) -> None:
    uri = f"sqlite:///{out / 'mlflow.db'}"
    history.record_verdicts(uri, "before", {"f" * 32: {"psnr": "worse"}})
    assert "verdicts were not logged" in caplog.text


def test_an_unknown_benchmark_is_refused(out: Path) -> None:
    done = CliRunner().invoke(app, ["history", "nobody", "--out", str(out)])
    assert "no benchmark is called 'nobody'; known: quick-ci" in str(done.exception)
    runs.open_benchmark(f"sqlite:///{out / 'mlflow.db'}", "empty", None)
    done = CliRunner().invoke(app, ["history", "empty", "--out", str(out)])
    assert "'empty' has no experiment that ended yet" in str(done.exception)
