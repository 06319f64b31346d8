"""Put a row into the registry; a registry that fails never costs a finished experiment."""

import csv
import logging
from pathlib import Path
from typing import Any

from tasks import registry
from tasks.row import Row
from tasks.stage import Artifact, Place

ROWS_FOLDER = "rows"


def record(
    place: Place,
    tracking_uri: str,
    row: Row,
    settings: dict[str, Any],
    artifacts: dict[str, Artifact],
    *,
    final: bool,
) -> Row:
    """Log a row and return it with its run's id, None where the registry failed.

    A row that is not ``final`` brings the files, splats and renders among them, and leaves the run
    open; the final one brings what was measured last.
    """
    try:
        experiment = registry.open_benchmark(
            tracking_uri, row["benchmark"], place.out / "mlflow-artifacts"
        )
        run_id = registry.record(
            tracking_uri,
            experiment,
            row,
            parameters=settings,
            curve=() if final else _curve(place, artifacts),
            files=() if final else _files(place, artifacts),
            final=final,
        )
    except Exception as error:  # whatever MLflow, its database or its server raise
        name = f"{row['capture']} {row['condition']} seed {row['seed']}"
        logging.getLogger("mattgs").warning("%s was not logged to MLflow: %s", name, error)
        return row

    return row | {"run_id": run_id}


def _curve(place: Place, artifacts: dict[str, Artifact]) -> list[dict[str, float]]:
    """Read the training curve, one mapping per line with ``step``."""
    if "train" not in artifacts:
        return []
    path = place.folder(artifacts["train"]) / "curve.csv"
    with path.open(newline="", encoding="utf-8") as file:
        return [{key: float(value) for key, value in line.items()} for line in csv.DictReader(file)]


def _files(place: Place, artifacts: dict[str, Artifact]) -> list[tuple[Path, str]]:
    """List what a run keeps: splats, curve, scores, renders and the stages' reports."""
    wanted = {
        "train": ("splats.ply", "training.json", "curve.csv"),
        "evaluate": ("evaluation.json", "renders"),
        "segment": ("masks.json",),
    }
    found = []
    for stage, names in wanted.items():
        if stage in artifacts:
            folder = place.folder(artifacts[stage])
            found += [
                (folder / name, name if (folder / name).is_dir() else "")
                for name in names
                if (folder / name).exists()
            ]
    return found
