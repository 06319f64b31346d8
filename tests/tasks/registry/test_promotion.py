"""A promoted run is its cell's baseline, and its splats a model that MLflow loads and renders."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.render import render_view
from tasks import splat_model
from tasks.registry import promotion, runs
from tasks.registry.lookup import find_run

CAMERA = Camera(Intrinsics(48, 32, 40.0, 40.0, 24.0, 16.0), np.eye(3), np.array([0.0, 0.0, 4.0]))
BLACK = (0.0, 0.0, 0.0)


def splats() -> Splats:
    rng = np.random.default_rng(5)
    cloud = Splats.zeros(60)
    cloud.means[:] = torch.from_numpy(rng.normal(0, 0.5, (60, 3)))
    cloud.log_scales[:] = -2.0
    cloud.quaternions[:, 0] = 1.0
    cloud.opacity_logits[:] = 2.0
    cloud.sh_dc[:] = torch.from_numpy(rng.uniform(-1, 1.5, (60, 3)))
    return cloud


def row(seed: int = 0, **changes: Any) -> dict[str, Any]:
    return {
        "benchmark": "small",
        "capture": "ball",
        "condition": "nobg-ours",
        "background": "nobg",
        "method": "ours",
        "seed": seed,
        "iterations": 100,
        "resolution": 64,
        "status": "finished",
        "reason": None,
        "metrics": {"psnr": 24.5, "splats": 60},
        "per_view": [],
        "provenance": {"config_digest": f"{seed}"},
    } | changes


@pytest.fixture(scope="module")
def place(
    fresh_registry: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, dict[str, str]]:
    """Return a registry on SQLite and the ids of its runs by seed, or by what they are."""
    folder = tmp_path_factory.mktemp("promotion")
    uri = f"sqlite:///{folder / 'mlflow.db'}"
    shutil.copy(fresh_registry, folder / "mlflow.db")
    experiment = runs.open_benchmark(uri, "small", folder / "artifacts")
    write_ply(splats(), folder / "splats.ply")
    (folder / "training.json").write_text(json.dumps({"background": BLACK}))
    files = [(folder / name, "") for name in ("splats.ply", "training.json")]
    ids = {
        str(seed): runs.record(uri, experiment, row(seed), parameters={}, files=files)
        for seed in (0, 1)
    }
    failed = row(2, status="failed", reason="no views", metrics={})
    ids["failed"] = runs.record(uri, experiment, failed, parameters={})
    return uri, ids


def test_a_promoted_run_loads_as_a_model_and_renders_what_its_splats_show(
    place: tuple[str, dict[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    import mlflow

    uri, ids = place
    address = promotion.promote(uri, find_run(uri, ids["0"]))
    assert address == "models:/small.ball.nobg-ours.100x64@baseline"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    model = mlflow.pyfunc.load_model(address)
    (image,) = model.predict(splat_model.row_of(CAMERA))
    assert np.array_equal(image, render_view(splats(), CAMERA, BLACK))
    assert image.std() > 10, "something is to be seen"
    moved = splat_model.row_of(CAMERA) | {"translation": [0.0, 0.0, 8.0]}
    near, far = model.predict([splat_model.row_of(CAMERA), moved])
    assert np.array_equal(near, image)
    assert (far > 0).sum() < (near > 0).sum()


def test_the_aliases_name_the_newest_promotion_of_each_seed(
    place: tuple[str, dict[str, str]],
) -> None:
    uri, ids = place
    for name in ("0", "1", "0"):
        promotion.promote(uri, find_run(uri, ids[name]))
    rows = promotion.aliased_rows(uri, "small", "baseline")
    assert [row["run_id"] for row in rows] == [ids["0"], ids["1"]]
    assert promotion.aliased_rows(uri, "small", "other") == []
    assert promotion.aliased_rows(uri, "elsewhere", "baseline") == []


def test_only_finished_runs_are_promoted(place: tuple[str, dict[str, str]]) -> None:
    uri, ids = place
    with pytest.raises(InputError, match="expected a finished one, found failed"):
        promotion.promote(uri, find_run(uri, ids["failed"]))


def test_runs_are_found_by_id_beginning_and_name(place: tuple[str, dict[str, str]]) -> None:
    uri, ids = place
    assert find_run(uri, ids["1"]).benchmark == "small"
    assert find_run(uri, ids["1"][:10]).run_id == ids["1"]
    assert find_run(uri, "ball nobg-ours seed 1").run_id == ids["1"]
    with pytest.raises(InputError, match="found no such run"):
        find_run(uri, "ball nobg-ours seed 7")
    with pytest.raises(InputError, match="found no such run"):
        find_run(uri, ids["1"][:3])


def test_a_name_that_two_runs_bear_is_refused_with_both(
    place: tuple[str, dict[str, str]], tmp_path: Path
) -> None:
    uri, ids = place
    experiment = runs.open_benchmark(uri, "other", tmp_path)
    twin = runs.record(uri, experiment, row(1, benchmark="other"), parameters={})
    with pytest.raises(InputError, match="expected one run, found 2") as error:
        find_run(uri, "ball nobg-ours seed 1")
    assert twin[:8] in str(error.value)
    assert ids["1"][:8] in str(error.value)


def test_a_camera_that_lacks_something_is_refused_by_name() -> None:
    whole = splat_model.row_of(CAMERA)
    found = splat_model.camera_of(whole)
    assert found.intrinsics == CAMERA.intrinsics
    assert np.array_equal(found.rotation, CAMERA.rotation)
    with pytest.raises(InputError, match="found no fx"):
        splat_model.camera_of({k: v for k, v in whole.items() if k != "fx"})
    with pytest.raises(InputError, match=r"`rotation`: expected finite \(3, 3\)"):
        splat_model.camera_of(whole | {"rotation": [[1, 0, 0], [0, 1, 0]]})
