"""Promotion: a run becomes the baseline of its cell, and its splats a registered model.

Each cell of a benchmark (capture, condition, iterations, resolution) is a registered model whose
versions are promoted runs. Two aliases name what counts: ``baseline``, the run promoted last, and
``baseline-seed-N``, the one of each seed, which the gate and the report compare with. The model is
of MLflow's pyfunc flavour (:mod:`tasks.registry.model`), a logged model of its run, and loads where
this project is not installed::

    mlflow.pyfunc.load_model("models:/quick.rover.nobg-ours.1000x320@baseline").predict(camera)
"""

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mattgs_ops.capture.scene import Scene
from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row
from tasks.registry import run_of_row
from tasks.registry.lookup import Found
from tasks.registry.model import saved
from tasks.registry.project import experiment_name
from tasks.registry.run_of_row import ROW_FILE, Row
from tasks.splat_model import row_of

BASELINE = "baseline"
MODEL_NAME = "splats"
BENCHMARK_TAG = "mattgs.benchmark"
SCENE_FILE = "scene/scene.json"


def promote(tracking_uri: str, found: Found, alias: str = BASELINE) -> str:
    """Give the run's cell this baseline; returns the registered model's address.

    A run that is promoted again keeps its version. Raises :class:`InputError` for a run that did
    not finish.
    """
    client = _client(tracking_uri)
    row = _row(client, found.run_id)
    if row["status"] != "finished":
        raise InputError(f"run {found}: expected a finished one, found {row['status']}")
    name = model_name(row)
    _open_model(client, name, row)
    version = _version_of(client, name, found.run_id) or _add_version(client, name, row, found)
    for each in (alias, _of_seed(alias, row)):
        client.set_registered_model_alias(name, each, version)
    client.set_tag(found.run_id, "promoted", alias)
    return f"models:/{name}@{alias}"


def aliased_rows(tracking_uri: str, benchmark: str, alias: str = BASELINE) -> list[Row]:
    """Return the rows of a benchmark's promoted runs: for each cell those of its seeds.

    Empty where nothing was promoted under this alias.
    """
    client = _client(tracking_uri)
    query = f"tags.`{BENCHMARK_TAG}` = '{experiment_name(benchmark)}'"
    models: list[Any] = []
    token = None
    while True:
        page = client.search_registered_models(filter_string=query, page_token=token)
        models += page
        token = page.token
        if not token:
            break
    rows = []
    for model in sorted(models, key=lambda model: str(model.name)):
        for each in sorted(model.aliases):
            if each.startswith(f"{alias}-seed-"):
                version = client.get_model_version_by_alias(model.name, each)
                rows.append(_row(client, version.run_id))
    return rows


def model_name(row: Mapping[str, Any]) -> str:
    """Return the registered model that a row's cell has."""
    size = f"{row['iterations']}x{row['resolution']}"
    size += f"x{row['budget']}" if row.get("budget") else ""
    parts = (
        experiment_name(row["benchmark"]).replace("/", "."),
        row["capture"],
        row["condition"],
        size,
    )
    # MLflow refuses these two; dots keep the parts apart
    return ".".join(str(part).replace("/", "-").replace(":", "-") for part in parts)


def _of_seed(alias: str, row: Row) -> str:
    return f"{alias}-seed-{row['seed']}"


def _open_model(client: Any, name: str, row: Row) -> None:
    from mlflow.exceptions import MlflowException

    tags = {BENCHMARK_TAG: experiment_name(row["benchmark"])}
    tags |= {key: str(row[key]) for key in run_of_row.TAGS if key != "seed"}
    try:
        client.create_registered_model(name, tags=tags)
    except MlflowException as error:
        if error.error_code != "RESOURCE_ALREADY_EXISTS":
            raise


def _version_of(client: Any, name: str, run_id: str) -> str | None:
    versions = client.search_model_versions(f"name = '{name}'")
    return next((str(v.version) for v in versions if v.run_id == run_id), None)


def _add_version(client: Any, name: str, row: Row, found: Found) -> str:
    """Log the run's splats as a model of the run, and register that."""
    from mlflow.entities import LoggedModelOutput

    run = client.get_run(found.run_id)
    tags = {"seed": str(row["seed"]), "splats": str(row["metrics"].get("splats", ""))}
    logged = client.create_logged_model(
        run.info.experiment_id, MODEL_NAME, source_run_id=found.run_id, tags=tags
    )
    try:
        with tempfile.TemporaryDirectory(prefix="mattgs-model-") as folder:
            _save(client, found.run_id, logged.model_id, Path(folder))
            client.log_model_artifacts(logged.model_id, str(Path(folder) / MODEL_NAME))
    except BaseException:
        client.finalize_logged_model(logged.model_id, "FAILED")
        raise
    client.finalize_logged_model(logged.model_id, "READY")
    client.log_outputs(found.run_id, [LoggedModelOutput(logged.model_id, step=0)])
    version = client.create_model_version(
        name, logged.artifact_location, run_id=found.run_id, tags=tags, model_id=logged.model_id
    )
    return str(version.version)


def _save(client: Any, run_id: str, model_id: str, folder: Path) -> None:
    for file in ("splats.ply", "training.json"):
        client.download_artifacts(run_id, file, str(folder))
    training = json.loads((folder / "training.json").read_text(encoding="utf-8"))
    settings = {"background": training["background"], "run": run_id}
    camera = _example_camera(client, run_id, folder)
    identity = {"model_id": model_id, "run_id": run_id}
    saved.save(folder / MODEL_NAME, folder / "splats.ply", settings, camera, identity)


def _example_camera(client: Any, run_id: str, folder: Path) -> dict[str, Any] | None:
    """Return a held-out camera of the run's scene, None where the run has no scene."""
    if not any(file.path == SCENE_FILE for file in client.list_artifacts(run_id, "scene")):
        return None
    path = client.download_artifacts(run_id, SCENE_FILE, str(folder))
    views = Scene.load(Path(path).parent).views
    cameras = [view.camera for view in views if view.split == "test" and view.camera is not None]
    return row_of(cameras[0]) if cameras else None


def _row(client: Any, run_id: str) -> Row:
    row = run_of_row.read_json(client, client.get_run(run_id), ROW_FILE)
    return checked_row(row, f"run {run_id}: {ROW_FILE}")


def _client(tracking_uri: str) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=tracking_uri, registry_uri=tracking_uri)
