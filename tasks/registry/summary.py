"""A benchmark as a whole in MLflow: its summary run, and everything a report is built from.

The summary run is the one run of a benchmark that stands for no experiment. It carries the rows of
the newest report, and the report with its tables and figures, so that the interface shows them
beside the runs. What pictures and splats a report needs lies in the runs themselves: a report can
be built again on a machine that has nothing but the registry.
"""

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row
from tasks.registry import runs
from tasks.registry.content import description
from tasks.registry.project import experiment_name
from tasks.registry.run_of_row import RECORDED_TAG, Row, files_of, read_json
from tasks.stages.stage import Cell

SUMMARY_TAG = "mattgs.summary"
ROWS_FILE = "rows.json"
REPORT_FOLDER = "report"
NOTE_LENGTH = 5000  # letters; MLflow refuses tags of more than 8000 bytes
WORDS_FILE, WORDS_END = "report.md", "## Tables"  # the report in words, and where the verdict ends
# What a row calls its folders → where their files lie in its run
PLACES = {"train": "", "evaluate": "", "scene": "scene"}


def record_summary(
    tracking_uri: str, experiment: str, benchmark: str, rows: Sequence[Row], report: Path
) -> str:
    """Log a benchmark's rows and the folder of its report; returns the summary run's id.

    A summary that was there before is replaced.
    """
    from mlflow.entities import Metric
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    old = _summaries(client, experiment)
    tags = {SUMMARY_TAG: benchmark, description.NOTE_TAG: _note(report)}
    run_id = str(client.create_run(experiment, tags=tags, run_name="summary").info.run_id)
    finished = [row for row in rows if row["status"] == "finished"]
    numbers = {
        "experiments": len(rows),
        "finished": len(finished),
        "failed": len(rows) - len(finished),
        "time": sum(float(row["metrics"].get("time", 0)) for row in finished),
    }
    now = time.time_ns() // 1_000_000
    client.log_batch(run_id, metrics=[Metric(k, float(v), now, 0) for k, v in numbers.items()])
    client.log_text(run_id, json.dumps(list(rows)), ROWS_FILE)
    client.log_artifacts(run_id, str(report), REPORT_FOLDER)
    client.set_terminated(run_id)
    for run in old:
        client.delete_run(run.info.run_id)
    return run_id


def purge(tracking_uri: str, *, dry_run: bool = False) -> list[str]:
    """Remove the files of summaries that newer ones have replaced; returns their runs' ids.

    The runs themselves stay in MLflow's list of deleted ones, until `mlflow gc`.
    """
    from mlflow.entities import ViewType
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    experiments = [one.experiment_id for one in client.search_experiments()]
    query, purged = f"tags.`{SUMMARY_TAG}` != ''", []
    for run in client.search_runs(experiments, query, ViewType.DELETED_ONLY):
        files = files_of(client, run)
        if files.list_artifacts():
            if not dry_run:
                files.delete_artifacts()
            purged.append(str(run.info.run_id))
    return purged


def _note(report: Path) -> str:
    """Return the report's verdict, and where the rest is."""
    path = report / WORDS_FILE
    words = path.read_text(encoding="utf-8").partition(WORDS_END)[0] if path.is_file() else ""
    return f"{words[:NOTE_LENGTH].rstrip()}\n\nTables, figures and the page: artifacts, `report/`."


def report_rows(tracking_uri: str, benchmark: str) -> list[Row]:
    """Return the rows that a benchmark's report is made of.

    They are those of its summary, which the newest run of the benchmark wrote; where experiments
    have ended since, or none was recorded, the newest row of each, newest first. Raises
    :class:`InputError` when there is no such benchmark.
    """
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    found = client.get_experiment_by_name(experiment_name(benchmark))
    if found is not None:
        summaries = _summaries(client, found.experiment_id)
        if summaries and not _ended_since(client, found.experiment_id, summaries[0]):
            run_id = summaries[0].info.run_id
            rows = read_json(client, summaries[0], ROWS_FILE)
            return [checked_row(row, f"run {run_id}: {ROWS_FILE}") for row in rows]
    newest: dict[Any, Row] = {}
    for row in runs.rows(tracking_uri, benchmark):
        newest.setdefault(runs.experiment_key(row), row)
    if not newest:
        raise InputError(f"benchmark {benchmark!r} has no recorded experiment yet")
    return list(newest.values())


def not_reported(tracking_uri: str, benchmark: str, rows: Sequence[Row]) -> int:
    """Count the recorded experiments that are none of ``rows``: the newest run lacked them."""
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    found = client.get_experiment_by_name(experiment_name(benchmark))
    known = {_place(str(Cell.of(row)), row) for row in rows}
    recorded = {
        _place(run.info.run_name, run.data.tags)
        for run in runs.pages(client, found.experiment_id)
        if run.info.status in ("FINISHED", "FAILED")
    }
    return len(recorded - known)


def _place(name: str, settings: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return an experiment's place in the benchmark, of a row or of its run's tags."""
    return name, str(settings["iterations"]), str(settings["resolution"])


def fetch(tracking_uri: str, rows: Sequence[Row], root: Path) -> Path:
    """Lay out the files of rows' runs below ``root`` as the store does, and return it.

    ``root`` then serves as the folder that rows' artifacts are relative to. Files of a local
    registry are linked, those of a server are downloaded into ``root``.
    """
    for row in rows:
        if not row.get("run_id") or not row.get("artifacts"):
            continue
        files = run_files(tracking_uri, row["run_id"], root / "runs")
        _link(files, row["artifacts"], root)
    return root


def run_files(tracking_uri: str, run_id: str, into: Path) -> Path:
    """Return the folder with all artifacts of a run; below ``into`` where it must be downloaded."""
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    place = urlparse(client.get_run(run_id).info.artifact_uri)
    if place.scheme in ("", "file"):
        from urllib.request import url2pathname

        return Path(url2pathname(place.path))
    target = into / run_id
    target.mkdir(parents=True, exist_ok=True)
    return Path(client.download_artifacts(run_id, "", str(target)))


def _link(files: Path, artifacts: Mapping[str, str], root: Path) -> None:
    for kind, inside in PLACES.items():
        place = root / artifacts.get(kind, "")
        source = files / inside
        if kind in artifacts and not place.exists() and source.is_dir():
            place.parent.mkdir(parents=True, exist_ok=True)
            place.symlink_to(source)


def _summaries(client: Any, experiment: str) -> list[Any]:
    query = f"tags.`{SUMMARY_TAG}` != ''"
    order = ["attributes.start_time DESC"]
    return list(client.search_runs([experiment], filter_string=query, order_by=order))


def _ended_since(client: Any, experiment: str, summary: Any) -> bool:
    """Whether an experiment's run was recorded after the summary, or is still under way."""
    query = "tags.`mattgs.row` != ''"
    running = f"{query} and attributes.status = 'RUNNING'"
    if client.search_runs([experiment], filter_string=running, max_results=1):
        return True
    # runs of earlier versions were not dated as their trainings, and have no such tag
    for order in (f"tags.`{RECORDED_TAG}` DESC", "attributes.end_time DESC"):
        (newest,) = client.search_runs(
            [experiment], filter_string=query, order_by=[order], max_results=1
        ) or [summary]
        ended = int(newest.data.tags.get(RECORDED_TAG, newest.info.end_time or 0))
        if ended > summary.info.end_time:
            return True
    return False
