"""The capture as the run's dataset, which fills the column *Dataset* and can be searched.

Two runs whose dataset has the same digest were given the same photos, byte for byte.
"""

import json
from typing import Any
from urllib.parse import urlparse

from tasks.registry.content.about import About

DIGEST_LETTERS = 12  # MLflow takes 36, and its interface shows them all in a narrow column
CONTEXT_TAG = "mlflow.data.context"  # MLflow's own: what the run used the dataset for


def log_dataset(client: Any, run_id: str, row: dict[str, Any], about: About) -> None:
    """Log the row's capture as input of the run; nothing where its digest is not known.

    MLflow keeps one dataset for a name and a digest: to log it again changes nothing.
    """
    digest = ((row.get("provenance") or {}).get("inputs") or {}).get("capture")
    if not digest:
        return
    from mlflow.entities import Dataset, DatasetInput, InputTag

    scheme = urlparse(about.photos).scheme
    dataset = Dataset(
        name=row["capture"],
        digest=str(digest)[:DIGEST_LETTERS],
        source_type="local" if scheme in ("", "file") else scheme,
        source=json.dumps({"uri": about.photos}),
        profile=json.dumps(_profile(row)),
    )
    tags = [InputTag(CONTEXT_TAG, "training")]
    client.log_inputs(run_id, [DatasetInput(dataset, tags)])


def _profile(row: dict[str, Any]) -> dict[str, Any]:
    """Return what MLflow shows of the dataset besides its name and source."""
    found = row.get("registration") or {}
    shown = ("views", "registered", "points")
    return {key: found[key] for key in shown if key in found}
