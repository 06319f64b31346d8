"""What people do with results: export splats, look at them, promote them; from a real registry."""

import json
import shutil
import sys
import urllib.request
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
from mattgs_ops.capture.scene import Scene, SparsePoints, View
from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.ply import read_ply, write_ply
from mattgs_ops.splat.gaussians import Splats
from tasks.registry import lookup, runs
from tests.reference.splat_formats import read_compressed_ply, read_splat, read_spz

COUNT = 40
SIZE = (32, 24)


@pytest.fixture(scope="module")
def out(fresh_registry: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an output folder whose registry holds one run with splats, cameras and a photo."""
    folder = tmp_path_factory.mktemp("results")
    rng = np.random.default_rng(2)
    cloud = Splats.zeros(COUNT)
    cloud.means[:] = torch.from_numpy(rng.normal(0, 0.4, (COUNT, 3)))
    cloud.log_scales[:] = torch.from_numpy(rng.uniform(-3, -2, (COUNT, 3)))
    cloud.quaternions[:] = torch.from_numpy(rng.normal(0, 1, (COUNT, 4)))
    cloud.opacity_logits[:] = 2.0
    files = folder / "files"
    scene = files / "scene"
    (scene / "photos").mkdir(parents=True)
    write_ply(cloud, files / "splats.ply")
    (files / "training.json").write_text(json.dumps({"background": [1, 1, 1]}))
    Image.new("RGB", SIZE, (200, 80, 60)).save(scene / "photos" / "0.jpg.png")
    lens = Intrinsics(*SIZE, 30.0, 30.0, 16.0, 12.0)
    views = tuple(
        View(f"{i}.jpg", "train", *SIZE, scene / "photos" / f"{i}.jpg.png", None,
             Camera(lens, np.eye(3), np.array([0.1 * i, 0.0, 4.0])))
        for i in range(3)
    )  # fmt: skip
    none = np.zeros((0, 3))
    points = SparsePoints(none, none.astype(np.uint8), np.zeros(0, np.float32), np.zeros(0, int))
    Scene("ball", scene, views, {}).save(points)
    uri = f"sqlite:///{folder / 'mlflow.db'}"
    shutil.copy(fresh_registry, folder / "mlflow.db")
    experiment = runs.open_benchmark(uri, "small", folder / "mlflow-artifacts")
    kept = [(files / name, "") for name in ("splats.ply", "training.json")]
    runs.record(uri, experiment, row(), parameters={}, files=[*kept, (scene, "scene")])
    return folder


def row() -> dict[str, Any]:
    return {
        "benchmark": "small", "capture": "ball", "condition": "nobg-ours", "background": "nobg",
        "method": "ours", "seed": 0, "iterations": 10, "resolution": 32, "status": "finished",
        "reason": None, "metrics": {"psnr": 20.0}, "per_view": [], "provenance": {},
        "artifacts": {"scene": "sfm/elsewhere/files"},
    }  # fmt: skip


def mattgs(*arguments: str | Path) -> str:
    done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize(
    ("form", "read"),
    [
        ("ply", lambda path: list(range(len(read_ply(path))))),
        ("splat", read_splat),
        ("spz", read_spz),
        ("compressed-ply", read_compressed_ply),
    ],
)
def test_a_run_is_exported_by_its_name(out: Path, tmp_path: Path, form: str, read: Any) -> None:
    path = tmp_path / "it"
    told = mattgs("export", "ball nobg-ours seed 0", "--format", form, "--file", path, "--out", out)
    assert f"{COUNT} splats" in told
    assert len(read(path)) == COUNT


def test_without_a_file_the_export_is_named_after_its_run(out: Path) -> None:
    mattgs("export", "ball nobg-ours seed 0", "--format", "spz", "--out", out)
    (path,) = (out / "exports").iterdir()
    assert path.name.startswith("small-ball-nobg-ours-seed-0-")
    assert path.suffix == ".spz"


def test_a_run_that_was_renamed_in_the_interface_stays_below_the_exports(out: Path) -> None:
    from mlflow.tracking import MlflowClient

    uri = f"sqlite:///{out / 'mlflow.db'}"
    client = MlflowClient(tracking_uri=uri)
    run_id = lookup.find_run(uri, "ball nobg-ours seed 0").run_id
    client.set_tag(run_id, "mlflow.runName", "../../../evil run")
    try:
        mattgs("export", run_id, "--format", "splat", "--out", out)
    finally:
        client.set_tag(run_id, "mlflow.runName", "ball nobg-ours seed 0")
    (path,) = (out / "exports").glob("*.splat")
    assert path.name.startswith("small-..-..-..-evil-run-")


def test_what_cannot_be_exported_is_refused_before_any_work(out: Path) -> None:
    with pytest.raises(InputError, match="format 'obj': expected one of ply"):
        mattgs("export", "ball nobg-ours seed 0", "--format", "obj", "--out", out)
    with pytest.raises(InputError, match=r"nothing\.ply: expected a PLY file"):
        mattgs("export", "nothing.ply", "--out", out)
    with pytest.raises(InputError, match="found no such run"):
        mattgs("export", "nobody", "--out", out)


def test_a_run_is_promoted_by_its_name(out: Path) -> None:
    told = mattgs("promote", "ball nobg-ours seed 0", "--out", out)
    assert "models:/small.ball.nobg-ours.10x32@baseline" in told


def test_the_viewer_serves_splats_cameras_and_photos(out: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="the extra `view` is not installed")
    server, told = view.start("ball nobg-ours seed 0", out, 0, tmp_path)
    try:
        address = f"http://127.0.0.1:{server.get_port()}"
        with urllib.request.urlopen(address, timeout=30) as page:
            assert page.status == 200
            assert b"<html" in page.read(10_000).lower()
        assert "3 cameras" in told
        shown = set(server.scene._handle_from_node_name)
        assert {"/splats", "/cameras/train/0.jpg", "/cameras/train/2.jpg"} <= shown
        cameras = server.scene._handle_from_node_name
        assert cameras["/cameras/train/0.jpg"].image.shape == (SIZE[1], SIZE[0], 3)
        assert cameras["/cameras/train/2.jpg"].image is None, "its photo is not in the registry"
        assert np.allclose(cameras["/cameras/train/2.jpg"].position, [-0.2, 0, -4])
    finally:
        server.stop()


def test_without_viser_it_is_said_what_to_install(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=r"pip install 'mattgs-bench\[view\]'"):
        view.start("ball nobg-ours seed 0", out, 0, tmp_path)
