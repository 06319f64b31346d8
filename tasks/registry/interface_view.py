"""How MLflow's interface shows a benchmark: which columns and charts, as what kind of project.

The interface keeps such views as tags of the experiment and lists them under *Views*. Interfaces
that do not know a part of it ignore that part.
"""

import json
from typing import Any

from mattgs_ops.score.metric_table import METRICS

KEY, NAME = "mattgs", "Benchmark"
VIEW_TAG = f"mlflow.sharedViewState.{KEY}"
CREATED = 1_700_000_000_000  # milliseconds; the interface wants a date, and the same one does
ATTRIBUTES = ("Dataset", "Source", "Models")  # as the interface calls its own columns
TAGS = ("capture", "background", "method", "seed", "status")
COLUMNS = ("ssim", "psnr", "l1", "loss", "fps", "time", "size_mb")
IN_MASK = ("mask_psnr", "core_psnr", "rim_psnr", "core_ssim")
NOTE = (
    "One run per experiment, and `summary` for all of them. *Views → Benchmark* shows the columns "
    "of the tables, and as charts quality against cost; group by the tag `condition` to average "
    "over seeds. Metrics without a prefix are of held-out views, `mask_…` inside the object's "
    "mask, `core_…` and `rim_…` in its core and on its rim, `detail_…` on its small parts, "
    "`train_…` of training views, `curve_…` by step."
)
SECTION, SECTION_NAME = "mattgs-charts", "Quality and cost"
MOST_RUNS = 100  # that one chart shows
EXPERIMENTS = "tags.capture != ''"  # leaves the summary out, which has none


def file_address(tracking_uri: str, experiment: str, run_id: str, file: str) -> str | None:
    """Return where the interface shows a file of a run; None where MLflow is no server."""
    if not tracking_uri.startswith("http"):
        return None
    return f"{tracking_uri.rstrip('/')}/#/experiments/{experiment}/runs/{run_id}/artifacts/{file}"


def experiment_tags() -> dict[str, str]:
    """Return the tags of a benchmark's MLflow experiment."""
    shown = [f"attributes.`{name}`" for name in ATTRIBUTES]
    shown += [f"tags.`{name}`" for name in TAGS]
    shown += [f"metrics.`{name}`" for name in (*COLUMNS, *IN_MASK) if name in METRICS]
    state = {
        "selectedColumns": shown,
        "orderByKey": "tags.`capture`",
        "orderByAsc": True,
        "hideEmptyCharts": True,
        "searchFilter": EXPERIMENTS,
        "runsHiddenMode": "SHOWALL",
        "compareRunCharts": charts(),
        "compareRunSections": [
            {
                "uuid": SECTION,
                "name": SECTION_NAME,
                "display": True,
                "isReordered": False,
                "deleted": False,
                "isGenerated": False,
            }
        ],
    }
    view = {"name": NAME, "createdAt": CREATED, "updatedAt": CREATED, "state": json.dumps(state)}
    return {
        # without it the interface opens on pages for language models
        "mlflow.experimentKind": "custom_model_development",
        "mlflow.note.content": NOTE,
        VIEW_TAG: json.dumps(view),
    }


def charts() -> list[dict[str, Any]]:
    """Return the charts that stand first: quality against cost, then how it came about."""
    conditions = {"selectedParams": ["capture", "background", "method"]}
    quality = {"selectedMetrics": ["mask_psnr", "psnr", "size_mb", "time"], "showAllRuns": True}
    found: list[dict[str, Any]] = [
        {"type": "PARALLEL", **conditions, **quality},
        *(
            {"type": "SCATTER", "xaxis": _metric(cost), "yaxis": _metric("mask_psnr")}
            for cost in ("size_mb", "time")
        ),
        {"type": "BAR", "metricKey": "mask_psnr"},
        *(
            {
                "type": "LINE",
                "metricKey": name,
                "selectedMetricKeys": [name],
                "xAxisKey": "step",
                "xAxisScaleType": "linear",
                "scaleType": "linear",
                "lineSmoothness": 0,
            }
            for name in ("curve_fixed_psnr", "curve_splats")
        ),
    ]
    common = {"metricSectionId": SECTION, "deleted": False, "isGenerated": False}
    return [
        {"uuid": f"{SECTION}-{place}", "runsCountToCompare": MOST_RUNS, **common, **chart}
        for place, chart in enumerate(found)
    ]


def _metric(name: str) -> dict[str, str]:
    return {"key": name, "type": "METRIC"}
