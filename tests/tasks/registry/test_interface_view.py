"""What MLflow's interface is told to show of a benchmark, and that old benchmarks get it too."""

import json
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.score.metric_table import METRICS
from tasks.registry import interface_view, runs
from tasks.row import SCHEMA


def state() -> dict[str, Any]:
    view = json.loads(interface_view.experiment_tags()[interface_view.VIEW_TAG])
    found: dict[str, Any] = json.loads(view["state"])
    return found


def test_charts_show_metrics_that_runs_have() -> None:
    asked = set()
    for chart in state()["compareRunCharts"]:
        asked |= {chart.get("metricKey"), *chart.get("selectedMetrics", ())}
        asked |= {chart[axis]["key"] for axis in ("xaxis", "yaxis") if axis in chart}
    curves = {name for name in asked if name and name.startswith("curve_")}
    assert curves == {"curve_fixed_psnr", "curve_splats"}
    assert asked - curves - {None} <= set(METRICS)


def test_the_view_shows_the_columns_of_the_interface_that_runs_fill() -> None:
    columns = state()["selectedColumns"]
    assert {"attributes.`Dataset`", "attributes.`Source`", "attributes.`Models`"} <= set(columns)
    assert {"tags.`capture`", "metrics.`mask_psnr`"} <= set(columns)


def test_charts_are_told_apart_and_lie_in_a_section_that_is_shown() -> None:
    found = state()
    (section,) = found["compareRunSections"]
    charts = found["compareRunCharts"]
    assert len({chart["uuid"] for chart in charts}) == len(charts)
    assert {chart["metricSectionId"] for chart in charts} == {section["uuid"]}
    assert section["display"]
    assert {"PARALLEL", "SCATTER"} <= {chart["type"] for chart in charts}


def test_the_view_shows_all_experiments_and_not_the_summary(
    fresh_registry: Path, tmp_path: Path
) -> None:
    from mlflow.tracking import MlflowClient

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    (tmp_path / "mlflow.db").write_bytes(fresh_registry.read_bytes())
    experiment = runs.open_benchmark(uri, "toy", tmp_path / "artifacts")
    client: Any = MlflowClient(tracking_uri=uri)
    client.create_run(experiment, tags={"mattgs.summary": "toy"}, run_name="summary")
    row = {
        "schema": SCHEMA, "benchmark": "toy", "capture": "ball", "condition": "nobg-ours",
        "background": "nobg", "method": "ours", "seed": 0, "iterations": 1, "resolution": 16,
        "status": "finished", "reason": None, "metrics": {"psnr": 20.0}, "per_view": [],
        "provenance": {}, "artifacts": {},
    }  # fmt: skip
    runs.record(uri, experiment, row, parameters={})
    found = client.search_runs([experiment], filter_string=state()["searchFilter"])
    assert [run.info.run_name for run in found] == ["ball nobg-ours seed 0"]


def test_a_benchmark_of_an_earlier_version_gets_the_view(
    fresh_registry: Path, tmp_path: Path
) -> None:
    from mlflow.tracking import MlflowClient

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    (tmp_path / "mlflow.db").write_bytes(fresh_registry.read_bytes())
    client: Any = MlflowClient(tracking_uri=uri)
    old = client.create_experiment("toy", tags={interface_view.VIEW_TAG: "{}", "mine": "kept"})
    assert runs.open_benchmark(uri, "toy", None) == old
    tags = client.get_experiment(old).tags
    assert (
        tags[interface_view.VIEW_TAG] == interface_view.experiment_tags()[interface_view.VIEW_TAG]
    )
    assert tags["mine"] == "kept"


def test_a_file_of_a_run_has_an_address_on_a_server_alone() -> None:
    where = ("7", "abc", "report/report.html")
    page = "http://desk:5000/#/experiments/7/runs/abc/artifacts/report/report.html"
    address = f"{page}?workflowType=machine_learning"
    assert interface_view.file_address("http://desk:5000/", *where) == address
    assert interface_view.file_address("sqlite:////out/mlflow.db", *where) is None


def test_each_benchmark_of_the_project_has_a_page_that_opens_on_the_view(
    fresh_registry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mlflow.tracking import MlflowClient

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    (tmp_path / "mlflow.db").write_bytes(fresh_registry.read_bytes())
    MlflowClient(tracking_uri=uri).create_experiment("not-a-benchmark")
    toy = runs.open_benchmark(uri, "toy", None)
    monkeypatch.setenv("MATTGS_PROJECT", "anna")
    hers = runs.open_benchmark(uri, "toy", None)
    assert interface_view.benchmark_pages(uri, "http://desk:5000/") == {
        "toy": f"http://desk:5000/#/experiments/{hers}/runs"
        "?workflowType=machine_learning&viewStateShareKey=mattgs"
    }
    monkeypatch.delenv("MATTGS_PROJECT")
    pages = interface_view.benchmark_pages(uri, "http://desk:5000/")
    assert list(pages) == ["anna/toy", "toy"], "the last one first"
    assert f"/{toy}/" in pages["toy"]
