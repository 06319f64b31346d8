"""Promotion: a run becomes the baseline of its cell, and its splats a registered model.

Each cell of a benchmark (capture, condition, iterations, resolution) is a registered model whose
versions are promoted runs. Two aliases name what counts: ``baseline``, the run promoted last, and
``baseline-seed-N``, the one of each seed, which the gate and the report compare with. The model is
of MLflow's pyfunc flavour (:mod:`tasks.splat_model`)::

    mlflow.pyfunc.load_model("models:/quick.rover.nobg-ours.1000x320@baseline").predict(camera)
"""

import json
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row
from tasks.registry import runs
from tasks.registry.lookup import Found
from tasks.registry.runs import ROW_FILE, Row

BASELINE = "baseline"
MODEL_FOLDER = "model"
BENCHMARK_TAG = "mattgs.benchmark"
LOADER = "tasks.splat_model"
EXAMPLE = {
    "width": 320, "height": 240, "fx": 280.0, "fy": 280.0, "cx": 160.0, "cy": 120.0,
    "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    "translation": [0.0, 0.0, 4.0],
}  # fmt: skip


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
    query = f"tags.`{BENCHMARK_TAG}` = '{benchmark}'"
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
    parts = (row["benchmark"], row["capture"], row["condition"], size)
    # MLflow refuses these two; dots keep the parts apart
    return ".".join(str(part).replace("/", "-").replace(":", "-") for part in parts)


def _of_seed(alias: str, row: Row) -> str:
    return f"{alias}-seed-{row['seed']}"


def _open_model(client: Any, name: str, row: Row) -> None:
    from mlflow.exceptions import MlflowException

    tags = {BENCHMARK_TAG: row["benchmark"]}
    tags |= {key: str(row[key]) for key in runs.TAGS if key != "seed"}
    try:
        client.create_registered_model(name, tags=tags)
    except MlflowException as error:
        if error.error_code != "RESOURCE_ALREADY_EXISTS":
            raise


def _version_of(client: Any, name: str, run_id: str) -> str | None:
    versions = client.search_model_versions(f"name = '{name}'")
    return next((str(v.version) for v in versions if v.run_id == run_id), None)


def _add_version(client: Any, name: str, row: Row, found: Found) -> str:
    """Log the run's splats as a model beside its other files, and register that."""
    with tempfile.TemporaryDirectory(prefix="mattgs-model-") as folder:
        model = _save_model(client, found.run_id, Path(folder))
        client.log_artifacts(found.run_id, str(model), MODEL_FOLDER)
    source = f"{client.get_run(found.run_id).info.artifact_uri}/{MODEL_FOLDER}"
    tags = {"seed": str(row["seed"]), "splats": str(row["metrics"].get("splats", ""))}
    version = client.create_model_version(name, source, run_id=found.run_id, tags=tags)
    return str(version.version)


def _save_model(client: Any, run_id: str, folder: Path) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MLflow's import warns of MLflow's own type hints
        import mlflow.pyfunc

    data = folder / "data"
    data.mkdir()
    for file in ("splats.ply", "training.json"):
        client.download_artifacts(run_id, file, str(data))
    training = json.loads((data / "training.json").read_text(encoding="utf-8"))
    (data / "training.json").unlink()
    settings = {"background": training["background"], "run": run_id}
    (data / "model.json").write_text(json.dumps(settings) + "\n", encoding="utf-8")
    mlflow.pyfunc.save_model(
        folder / MODEL_FOLDER,
        loader_module=LOADER,
        data_path=str(data),
        pip_requirements=["mattgs-bench"],  # else MLflow installs the world to find out
        metadata={"camera": EXAMPLE},
    )
    return folder / MODEL_FOLDER


def _row(client: Any, run_id: str) -> Row:
    path = client.download_artifacts(run_id, ROW_FILE)
    return checked_row(json.loads(Path(path).read_text("utf-8")), f"run {run_id}: {ROW_FILE}")


def _client(tracking_uri: str) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=tracking_uri, registry_uri=tracking_uri)
