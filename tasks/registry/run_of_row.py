"""The run that belongs to a row: found or made, opened, given the row, closed.

The tags ``mattgs.row`` and ``mattgs.training`` name a run's row and training. Its start and end are
those of the training, whenever it is recorded; when that was, the tag ``mattgs.recorded`` says.
"""

import hashlib
import json
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tasks.registry.content import dataset, description, origin, owner, values
from tasks.registry.content.about import About, milliseconds
from tasks.stages.stage import Cell

Row = dict[str, Any]

ROW_FILE = "row.json"
ROW_TAG, TRAINING_TAG = "mattgs.row", "mattgs.training"
OWNER_TAG = "mattgs.owner"  # of runs under way: see content/owner.py
RECORDED_TAG = "mattgs.recorded"  # milliseconds since the epoch
TAGS = ("capture", "condition", "background", "method", "seed", "iterations", "resolution")
IDENTITY = ("benchmark", *TAGS, "budget")  # the last where the grid has budgets


def row_key(row: Mapping[str, Any]) -> str:
    """Identify a row: its place in the grid, its configuration, inputs and code.

    The same experiment run again has the same key, whatever came out.
    """
    provenance = row.get("provenance") or {}
    parts: dict[str, Any] = {name: row[name] for name in IDENTITY if name in row}
    parts |= {name: provenance.get(name) for name in ("config_digest", "code_version", "inputs")}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:32]


def find_or_make(client: Any, experiment: str, row: Row, training: str | None, about: About) -> Any:
    """Return the row's run, made when there is none, with its tags and its dataset.

    The run is as it was found: it does not know yet what is logged to it here.
    """
    run = find(client, experiment, row, training)
    if run is None:
        name = str(Cell.of(row))
        start = milliseconds(about.began)
        tags = _tags(row, training, about, {})
        run = client.create_run(experiment, start_time=start, tags=tags, run_name=name)
    else:
        values.log_tags(client, run.info.run_id, _tags(row, training, about, run.data.tags))
    dataset.log_dataset(client, run.info.run_id, row, about)
    return run


def find(client: Any, experiment: str, row: Row, training: str | None) -> Any | None:
    """Return the run of a row; of another training of the same row it is another one."""
    query = f"tags.`{ROW_TAG}` = '{row_key(row)}'"
    found = client.search_runs([experiment], filter_string=query)
    mine = [run for run in found if run.data.tags.get(TRAINING_TAG, training) == training]
    if training is None and not mine:  # it ended before it trained, where others got further
        mine = list(found)
    return mine[0] if mine else None


def open_run(client: Any, run_id: str) -> None:
    """Show the run as running, and this process as the one that works on it."""
    client.set_tag(run_id, OWNER_TAG, owner.owner())
    client.update_run(run_id, status="RUNNING")


def has_row(client: Any, run: Any) -> bool:
    """Whether the run holds a row; it is stored last, so all else is there with it."""
    return any(file.path == ROW_FILE for file in files_of(client, run).list_artifacts())


def read_json(client: Any, run: Any, file: str) -> Any:
    """Return what a JSON file among a run's artifacts holds; leaves no copy behind."""
    with tempfile.TemporaryDirectory(prefix="mattgs-run-") as folder:
        path = files_of(client, run).download_artifacts(file, folder)
        return json.loads(Path(path).read_text(encoding="utf-8"))


def files_of(client: Any, run: Any) -> Any:
    """Return a run's artifacts; by the run's id MLflow would ask its database for each file."""
    from mlflow.store.artifact.artifact_repository_registry import get_artifact_repository

    return get_artifact_repository(run.info.artifact_uri, client.tracking_uri)


def stored_row(client: Any, run: Any) -> Row | None:
    """Return the row that a run holds, None where there is none."""
    if not has_row(client, run):
        return None
    row: Row = read_json(client, run, ROW_FILE)
    return row


def store_row(client: Any, run_id: str, row: Row, before: Row | None) -> None:
    """Store a row unless it is there, or there with what was measured later."""
    row = row | {"run_id": run_id}
    if before is not None:
        later = {k: (before.get(k) or {}) | (row.get(k) or {}) for k in ("metrics", "provenance")}
        if row | later == before:
            return
    client.log_dict(run_id, row, ROW_FILE)


def end(client: Any, run_id: str, row: Row, before: Row | None, about: About) -> None:
    """Store the row and close its run, dated as its training."""
    row = row | {"run_id": run_id}
    if row != before:
        client.log_dict(run_id, row, ROW_FILE)
    client.set_tag(run_id, RECORDED_TAG, str(time.time_ns() // 1_000_000))
    status = "FINISHED" if row["status"] == "finished" else "FAILED"
    client.set_terminated(run_id, status, milliseconds(about.ended))


def update_state(client: Any, run: Any, row: Row, about: About) -> None:
    """Bring the tags that say how it ended, and the description, up to date."""
    old_tags = run.data.tags
    new = _state(row) | description.tags(row, about, old_tags)
    changed = {name: value for name, value in new.items() if old_tags.get(name) != value}
    if changed:
        values.log_tags(client, run.info.run_id, changed)


def _tags(row: Row, training: str | None, about: About, old_tags: dict[str, str]) -> dict[str, str]:
    provenance = row.get("provenance") or {}
    found = {name: str(row[name]) for name in IDENTITY[1:] if name in row}
    found |= _state(row) | {
        ROW_TAG: row_key(row),
        "code_version": str(provenance.get("code_version", "")),
        "git": str(provenance.get("git", "")),
        "config_digest": str(provenance.get("config_digest", "")),
        "inputs": json.dumps(provenance.get("inputs") or {}, sort_keys=True),
        "protocol": str(row.get("protocol", "")),
    }
    found |= {} if training is None else {TRAINING_TAG: training}
    return found | origin.tags(row, about) | description.tags(row, about, old_tags)


def _state(row: Row) -> dict[str, str]:
    warnings = "; ".join(one["text"] for one in row.get("warnings") or ())
    ended = {"status": row["status"], "reason": str(row.get("reason") or ""), "warnings": warnings}
    machines = {"timed_on": _machine(row, "timed"), "measured_on": _machine(row, "measured")}
    return ended | machines


def _machine(row: Row, what: str) -> str:
    """Say what a speed of the row was taken on: the machine that is named for it, or the row's."""
    provenance = row.get("provenance") or {}
    machine = provenance.get(what) or provenance
    names = ("cpu", "cpu_kind", "cores", "threads", "workload")
    return ", ".join(f"{name} {machine[name]}" for name in names if machine.get(name) is not None)
