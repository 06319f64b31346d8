"""What MLflow's interface shows of a run beside its numbers, asked of a real server."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from tasks.registry import lookup, promotion, runs, summary
from tasks.registry.content.about import About

pytestmark = pytest.mark.slow  # the server takes that long to start

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "mlflow.md"
COMMIT = "a" * 40
DIGEST = "b" * 64
BEGAN, ENDED = 1_760_000_000.25, 1_760_000_057.5
ABOUT = About("file:///photos/ball", "mattgs run", BEGAN, ENDED)


def row(benchmark: str, seed: int = 0, **changes: Any) -> dict[str, Any]:
    return {
        "schema": 1, "benchmark": benchmark, "capture": "ball", "condition": "nobg-ours+",
        "background": "nobg", "method": "ours+", "seed": seed, "iterations": 1000,
        "resolution": 320, "status": "finished", "reason": None,
        "metrics": {"psnr": 21.0, "mask_psnr": 26.5, "size_mb": 2.0},
        "per_view": [], "artifacts": {}, "run_id": None,
        "warnings": [{"about": "masks", "text": "two masks are in doubt", "serious": False}],
        "registration": {"views": 20, "registered": 19},
        "provenance": {"git": f"{COMMIT}+changes", "inputs": {"capture": DIGEST}},
    } | changes  # fmt: skip


SETTINGS = {"method": "ours+", "capture": "ball", "train": {"lr_scale": 0.005}}


def client_of(server: str) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=server)


def recorded(server: str, one: dict[str, Any], about: About = ABOUT) -> Any:
    experiment = runs.open_benchmark(server, one["benchmark"], None)
    run_id = runs.record(server, experiment, one, parameters=SETTINGS, about=about, final=False)
    runs.finish(server, one, one | {"run_id": run_id}, about)
    return client_of(server).get_run(run_id)


def test_a_run_has_its_capture_as_dataset_and_where_it_came_from(server: str) -> None:
    run = recorded(server, row("origin"))
    (found,) = run.inputs.dataset_inputs
    assert (found.dataset.name, found.dataset.digest) == ("ball", DIGEST[:12])
    assert json.loads(found.dataset.source) == {"uri": "file:///photos/ball"}
    assert json.loads(found.dataset.profile) == {"views": 20, "registered": 19}
    assert [(t.key, t.value) for t in found.tags] == [("mlflow.data.context", "training")]
    tags = run.data.tags
    assert tags["mlflow.source.name"] == "mattgs run"
    assert tags["mlflow.source.git.commit"] == COMMIT
    assert tags["mlflow.user"]
    again = recorded(server, row("origin"))
    assert again.info.run_id == run.info.run_id
    assert len(again.inputs.dataset_inputs) == 1


def test_a_run_is_dated_as_its_training_not_as_its_recording(server: str) -> None:
    run = recorded(server, row("dated"))
    assert (run.info.start_time, run.info.end_time) == (1_760_000_000_250, 1_760_000_057_500)
    assert run.info.status == "FINISHED"
    newer = recorded(server, row("dated", 1), About(began=BEGAN - 500, ended=BEGAN - 400))
    assert newer.info.start_time < run.info.start_time
    found = [one["seed"] for one in runs.rows(server, "dated")]
    assert found == [1, 0], "rows come by when they were recorded, newest first"


def test_a_report_knows_of_rows_that_were_recorded_after_its_summary(
    server: str, tmp_path: Path
) -> None:
    """Trainings from the store are older than the summary; they count when they are recorded."""
    first = recorded(server, row("summed")).info
    known = [row("summed") | {"run_id": first.run_id}]
    (tmp_path / "report.html").write_text("page")
    summary.record_summary(server, first.experiment_id, "summed", known, tmp_path)
    assert summary.report_rows(server, "summed") == known
    recorded(server, row("summed", 5), About(began=BEGAN - 500, ended=BEGAN - 400))
    assert {one["seed"] for one in summary.report_rows(server, "summed")} == {0, 5}


def test_the_description_says_what_the_run_is_and_keeps_what_a_person_wrote(server: str) -> None:
    running = row("described", status="running", metrics={}, warnings=[])
    experiment = runs.open_benchmark(server, "described", None)
    run_id = runs.begin(server, experiment, running, SETTINGS, about=ABOUT)
    assert "Not finished yet" in note(server, run_id)
    recorded(server, row("described"))
    text = note(server, run_id)
    assert "**ball** with the background removed, trained by **ours+** for 1,000 steps" in text
    assert "| PSNR in mask | 26.50 dB |" in text
    assert "**Warning:** two masks are in doubt" in text
    assert "`file:///photos/ball`, digest `bbbbbbbbbbbb`" in text
    assert "Not finished" not in text
    client_of(server).set_tag(run_id, "mlflow.note.content", "my own words")
    recorded(server, row("described", metrics={"psnr": 22.0}))
    assert note(server, run_id) == "my own words"


def note(server: str, run_id: str) -> str:
    return str(client_of(server).get_run(run_id).data.tags["mlflow.note.content"])


def test_the_load_of_a_training_is_its_system_metrics_and_comes_once(server: str) -> None:
    samples = [
        {"step": k, "time": BEGAN + 5 * k, "cpu_utilization_percentage": 40.0 + k} for k in (1, 2)
    ]
    experiment = runs.open_benchmark(server, "loaded", None)
    for known in (samples[:1], samples, samples):
        run_id = runs.record(
            server, experiment, row("loaded"), parameters={}, load=known, about=ABOUT
        )
    history = client_of(server).get_metric_history(run_id, "system/cpu_utilization_percentage")
    assert [(m.step, m.value, m.timestamp) for m in history] == [
        (1, 41.0, 1_760_000_005_250),
        (2, 42.0, 1_760_000_010_250),
    ]


def test_the_searches_of_the_document_find_what_they_say(server: str) -> None:
    queries = re.findall(r"```sql\n(.*?)\n```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    assert len(queries) == 3
    experiment = runs.open_benchmark(server, "searched", None)
    rover = {"capture": "rover"}
    reason = "sfm: 5 of 20 photos were registered"
    ids = {
        "good": recorded(server, row("searched")),
        "large": recorded(server, row("searched", 1, metrics={"mask_psnr": 26.0, "size_mb": 9.0})),
        "rover": recorded(server, row("searched", 2, metrics={}, **rover)),
        "failed": recorded(server, row("searched", 3, status="failed", reason=reason, metrics={})),
    }
    found = []
    for query in queries:
        page = client_of(server).search_runs([experiment], filter_string=query)
        found.append([name for name, run in ids.items() if run.info.run_id in
                      {one.info.run_id for one in page}])  # fmt: skip
    assert found == [["good"], ["rover"], ["failed"]]
    nested = "params.`train.lr_scale` = '0.005'"
    assert nested in DOCUMENT.read_text(encoding="utf-8")
    assert len(client_of(server).search_runs([experiment], filter_string=nested)) == len(ids)
    digest = f"dataset.digest = '{DIGEST[:12]}'"
    assert len(client_of(server).search_runs([experiment], filter_string=digest)) == len(ids)


def test_two_projects_on_one_server_stay_apart(
    server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ids = {}
    for name, seed in (("anna", 1), ("ben", 2)):
        monkeypatch.setenv("MATTGS_PROJECT", name)
        ids[name] = recorded(server, row("mine", seed)).info.run_id
        recorded(server, row("mine", 3))
    for name, seed in (("anna", 1), ("ben", 2)):
        monkeypatch.setenv("MATTGS_PROJECT", name)
        assert {one["seed"] for one in runs.rows(server, "mine")} == {seed, 3}
        assert runs.benchmarks(server) == ["mine"]
        assert lookup.find_run(server, f"ball nobg-ours+ seed {seed}").run_id == ids[name]
        assert lookup.find_run(server, "ball nobg-ours+ seed 3").benchmark == "mine"
        assert promotion.model_name(row("mine")) == f"{name}.mine.ball.nobg-ours+.1000x320"
    assert {"anna/mine", "ben/mine"} <= set(runs.experiments(server))
    monkeypatch.delenv("MATTGS_PROJECT")
    with pytest.raises(InputError, match="no benchmark is called 'mine'"):
        runs.rows(server, "mine")
    monkeypatch.setenv("MATTGS_PROJECT", "../anna")
    with pytest.raises(InputError, match="MATTGS_PROJECT: expected letters"):
        runs.rows(server, "mine")
