"""How MLflow's interface shows a benchmark: which columns, in which order, as what kind of project.

The interface keeps such views as tags of the experiment and lists them under *Views*; the address
ending in :data:`QUERY` opens ours. Older interfaces ignore the tags.
"""

import json

from mattgs_ops.metrics import METRICS

KEY, NAME = "mattgs", "Benchmark"
QUERY = f"viewStateShareKey={KEY}"
CREATED = 1_700_000_000_000  # milliseconds; the interface wants a date, and the same one does
TAGS = ("capture", "background", "method", "seed", "status")
COLUMNS = ("ssim", "psnr", "l1", "loss", "fps", "time", "size_mb")
IN_MASK = ("mask_psnr", "mask_ssim")
NOTE = (
    "One run per experiment, and `summary` for all of them. *Views → Benchmark* shows the columns "
    "of the tables; group by the tag `condition` to average over seeds. Metrics without a prefix "
    "are of held-out views, `mask_…` inside the object's mask, `train_…` of training views, "
    "`curve_…` by step."
)


def experiment_tags() -> dict[str, str]:
    """Return the tags of a benchmark's MLflow experiment."""
    shown = [f"tags.`{name}`" for name in TAGS]
    shown += [f"metrics.`{name}`" for name in (*COLUMNS, *IN_MASK) if name in METRICS]
    state = {
        "selectedColumns": shown,
        "orderByKey": "tags.`capture`",
        "orderByAsc": True,
        "hideEmptyCharts": True,
    }
    view = {"name": NAME, "createdAt": CREATED, "updatedAt": CREATED, "state": json.dumps(state)}
    return {
        # without it the interface opens on pages for language models
        "mlflow.experimentKind": "custom_model_development",
        "mlflow.note.content": NOTE,
        f"mlflow.sharedViewState.{KEY}": json.dumps(view),
    }
