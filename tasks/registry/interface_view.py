"""How MLflow's interface shows a benchmark: which columns and charts, as what kind of project.

The interface keeps such views as tags of the experiment and lists them under *Views*. Interfaces
that do not know a part of it ignore that part.
"""

import json
from typing import Any

from mattgs_ops.score.metric_table import METRICS
from tasks.registry.project import benchmark_name, is_ours

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
TRAINING = "workflowType=machine_learning"  # else the interface's pages are those for agents
EXPERIMENTS = "tags.capture != ''"  # leaves the summary out, which has none


def file_address(tracking_uri: str, experiment: str, run_id: str, file: str) -> str | None:
    """Return where the interface shows a file of a run; None where MLflow is no server."""
    if not tracking_uri.startswith("http"):
        return None
    return front_page(tracking_uri, f"/{experiment}/runs/{run_id}/artifacts/{file}")


def front_page(server: str, below: str = "") -> str:
    """Return where the interface of ``server`` lists the experiments, or a page ``below`` that."""
    return f"{server.rstrip('/')}/#/experiments{below}?{TRAINING}"


def benchmark_pages(tracking_uri: str, server: str) -> dict[str, str]:
    """Return where ``server`` shows each recorded benchmark of this project, the last one first.

    The page opens on the columns of the tables.
    """
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    found = client.search_experiments(order_by=["last_update_time DESC"])
    return {
        benchmark_name(one.name): (
            f"{front_page(server, f'/{one.experiment_id}/runs')}&viewStateShareKey={KEY}"
        )
        for one in found
        if VIEW_TAG in one.tags and is_ours(one.name)
    }


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
        # the switch between GenAI and model training in the interface counts more: see TRAINING
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
