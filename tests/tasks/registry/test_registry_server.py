"""The registry as a server that others share: nothing lost, reports from it alone, models, splats.

A real ``mlflow server`` on loopback (``conftest.py``).
"""

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from typer.testing import CliRunner

from flows.cli.app import app
from flows.results import view
from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import Scene, SparsePoints, Split, View
from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.ply import read_ply, write_ply
from mattgs_ops.splat.gaussians import Splats
from reports.page.build import build
from tasks import splat_model
from tasks.registry import runs, summary

pytestmark = pytest.mark.slow

LOGGERS, ROWS_EACH, POINTS = 12, 1, 150
LOADING = 240  # seconds that a busy machine may take for it
COUNT = 40  # splats


@pytest.fixture(autouse=True)
def environment(server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", server)


def row(seed: int, benchmark: str) -> dict[str, Any]:
    metrics = dict.fromkeys(("ssim", "psnr", "l1", "loss", "fps", "time", "size_mb"), 1.0)
    return {
        "schema": 1, "benchmark": benchmark, "capture": "ball", "condition": "nobg-ours",
        "background": "nobg", "method": "ours", "seed": seed, "iterations": 10, "resolution": 32,
        "status": "finished", "reason": None, "metrics": metrics,
        "per_view": [{"view": "0.jpg", "split": "test", "psnr": 1.0}], "provenance": {},
        "artifacts": {"scene": "sfm/a/files", "train": "train/b/files"}, "run_id": None,
    }  # fmt: skip


def test_twelve_that_log_at_once_lose_nothing(server: str) -> None:
    experiment = runs.open_benchmark(server, "crowd", None)
    curve = [{"step": step, "loss": 1 / (step + 1)} for step in range(POINTS)]

    def log(number: int) -> list[str]:
        mine = [row(number * ROWS_EACH + k, "crowd") for k in range(ROWS_EACH)]
        return [
            runs.record(server, experiment, one, parameters={"a": 1}, curve=curve) for one in mine
        ]

    with ThreadPoolExecutor(LOGGERS) as pool:
        logged = [run for ids in pool.map(log, range(LOGGERS)) for run in ids]
    assert len(set(logged)) == LOGGERS * ROWS_EACH
    found = runs.rows(server, "crowd")
    assert sorted(one["seed"] for one in found) == list(range(LOGGERS * ROWS_EACH))
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=server)
    for run in (logged[0], logged[-1]):
        assert len(client.get_metric_history(run, "curve_loss")) == POINTS
        assert client.get_run(run).data.params == {"a": "1"}


@pytest.fixture(scope="module")
def run_id(server: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Record a run with splats and cameras, and its benchmark's summary; return the run's id."""
    files = tmp_path_factory.mktemp("run")
    rng = np.random.default_rng(4)
    cloud = Splats.zeros(COUNT)
    cloud.means[:] = torch.from_numpy(rng.normal(0, 0.4, (COUNT, 3)))
    cloud.log_scales[:] = -2.0
    cloud.quaternions[:, 0] = 1.0
    cloud.opacity_logits[:] = 2.0
    write_ply(cloud, files / "splats.ply")
    (files / "training.json").write_text(json.dumps({"background": [1, 1, 1]}))
    scene = files / "scene"
    scene.mkdir()
    splits: tuple[Split, ...] = ("test", "train", "train")
    views = tuple(
        View(f"{i}.jpg", splits[i], 32, 24, scene / f"{i}.jpg", None, camera(i)) for i in range(3)
    )
    for shot in views:
        Image.new("RGB", (32, 24), (200, 80, 60)).save(shot.photo)
    none = np.zeros((0, 3))
    points = SparsePoints(none, none.astype(np.uint8), np.zeros(0, np.float32), np.zeros(0, int))
    Scene("ball", scene, views, {}).save(points)
    experiment = runs.open_benchmark(server, "served", None)
    kept = [(files / "splats.ply", ""), (files / "training.json", ""), (scene, "scene")]
    run = runs.record(server, experiment, row(0, "served"), parameters={}, files=kept)
    rows = [row(0, "served") | {"run_id": run}]
    report = build(
        rows,
        files / "report",
        title="Benchmark served",
        artifacts_root=summary.fetch(server, rows, files / "root"),
    ).parent
    summary.record_summary(server, experiment, "served", rows, report)
    return run


def camera(index: int) -> Camera:
    return Camera(
        Intrinsics(32, 24, 30.0, 30.0, 16.0, 12.0), np.eye(3), np.array([0.1 * index, 0, 4])
    )


def mattgs(*arguments: str | Path) -> str:
    done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_a_report_is_built_from_the_server_alone_byte_for_byte(
    server: str, run_id: str, tmp_path: Path
) -> None:
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=server)
    experiment = client.get_experiment_by_name("served").experiment_id
    assert client.get_run(run_id).info.status == "FINISHED"
    (summary,) = client.search_runs([experiment], "tags.`mattgs.summary` = 'served'")
    first = Path(client.download_artifacts(summary.info.run_id, "report", str(tmp_path)))
    mattgs("report", "served", "--out", tmp_path / "out")
    again = tmp_path / "out" / "benchmarks" / "served"
    names = sorted(str(p.relative_to(first)) for p in first.rglob("*") if p.is_file())
    assert names == sorted(str(p.relative_to(again)) for p in again.rglob("*") if p.is_file())
    assert [n for n in names if (first / n).read_bytes() != (again / n).read_bytes()] == []
    assert "## Verdict" in summary.data.tags["mlflow.note.content"]


def test_splats_are_exported_shown_and_promoted_from_the_server(
    run_id: str, tmp_path: Path
) -> None:
    import mlflow

    file = tmp_path / "it.ply"
    mattgs("export", run_id[:8], "--file", file, "--out", tmp_path)
    assert len(read_ply(file)) == COUNT
    shown, told = view.start(run_id, tmp_path, 0, tmp_path / "view")
    shown.stop()
    assert "splats and 3 cameras" in told
    address = mattgs("promote", run_id, "--out", tmp_path).strip().rpartition(": ")[2]
    assert address == "models:/served.ball.nobg-ours.10x32@baseline"
    (image,) = mlflow.pyfunc.load_model(address).predict(splat_model.row_of(camera(0)))
    assert image.shape == (24, 32, 3)
    assert image.std() > 5


# Hides the installed project from a process; what a model carries is found all the same
WITHOUT_PROJECT = """
import sys
from importlib.machinery import PathFinder

class WithoutProject(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name in ("mattgs_ops", "tasks"):
            path = [entry for entry in sys.path if entry.endswith("carried")]
        return super().find_spec(name, path, target)

others = [one for one in sys.meta_path if "editable" not in type(one).__module__]
sys.meta_path[:] = [WithoutProject if one is PathFinder else one for one in others]
import mlflow.pyfunc

model = mlflow.pyfunc.load_model(sys.argv[1])
(image,) = model.predict(model.input_example)
print(*image.shape, image.sum(), "carried" in sys.modules["mattgs_ops"].__file__)
"""


def test_a_promoted_model_says_what_it_takes_and_carries_its_code(
    server: str, run_id: str, tmp_path: Path
) -> None:
    import mlflow
    from mlflow.tracking import MlflowClient

    address = mattgs("promote", run_id, "--out", tmp_path).strip().rpartition(": ")[2]
    client: Any = MlflowClient(tracking_uri=server)
    (output,) = client.get_run(run_id).outputs.model_outputs
    version = client.get_model_version_by_alias("served.ball.nobg-ours.10x32", "baseline")
    logged = client.get_logged_model(output.model_id)
    assert (logged.source_run_id, str(logged.status)) == (run_id, "READY")
    assert version.source == logged.artifact_location
    assert '"served.ball.nobg-ours.10x32"' in logged.tags["mlflow.modelVersions"]
    model = mlflow.pyfunc.load_model(address)
    assert model.metadata.signature.inputs.input_names() == list(splat_model.COLUMNS)
    listed = Path(mlflow.pyfunc.get_model_dependencies(address)).read_text(encoding="utf-8")
    names = {line.partition("==")[0] for line in listed.split()}
    assert {"mlflow", "numpy", "torch"} <= names
    assert "mattgs-bench" not in names, "it is on no index"
    example = model.input_example
    assert example.to_dict("records")[0]["translation"] == [0.0, 0.0, 4.0], "its held-out camera"
    (image,) = model.predict(example)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", WITHOUT_PROJECT, address],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=LOADING,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["24", "32", "3", str(image.sum()), "True"]


def test_the_ui_command_names_the_server_instead_of_serving_it(
    server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = mattgs("ui", "--no-browser", "--out", tmp_path)
    assert told.startswith(f"MLflow: {server}/#/experiments?workflowType=machine_learning (")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    with pytest.raises(InputError, match=r"MLFLOW_TRACKING_URI=http://127.0.0.1:9: no server"):
        mattgs("ui", "--no-browser", "--out", tmp_path)
