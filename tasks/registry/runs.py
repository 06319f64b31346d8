"""Rows in MLflow: which run a row belongs to, and how it is begun, updated and read back.

One MLflow experiment per benchmark, one flat run per row (nested runs break the comparison charts).
A run carries tags to group and filter by, the configuration as flat parameters, the row's metrics
under their plain names, the training curve as metrics ``curve_*`` by step, and the per-view scores
and the row itself as artifacts. A row that is recorded again updates its run, which the tags
``mattgs.row`` and ``mattgs.training`` (the training's key) name. What a run has is not logged
again.

A fresh SQLite database must be initialised once (:func:`initialise`) before several processes use
it: concurrent first use would corrupt it for good.
"""

import hashlib
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row
from tasks.registry import interface_view, run_content, run_owner

Row = dict[str, Any]

ROW_FILE, CONFIG_FILE = "row.json", "config.json"
ROW_TAG, TRAINING_TAG = "mattgs.row", "mattgs.training"
OWNER_TAG = "mattgs.owner"  # of runs under way: see tasks/registry/run_owner.py
TAGS = ("capture", "condition", "background", "method", "seed", "iterations", "resolution")
IDENTITY = ("benchmark", *TAGS)


def initialise(tracking_uri: str) -> None:
    """Create the database's tables; raises :class:`InputError` when the place cannot be used."""
    from mlflow.exceptions import MlflowException

    if tracking_uri.startswith("sqlite:///"):
        Path(tracking_uri.removeprefix("sqlite:///")).parent.mkdir(parents=True, exist_ok=True)
    try:
        _client(tracking_uri).search_experiments(max_results=1)
    except MlflowException as error:
        raise InputError(f"MLflow at {tracking_uri} cannot be used: {error}") from error


def open_benchmark(tracking_uri: str, benchmark: str, artifacts: Path | None) -> str:
    """Return the id of the benchmark's MLflow experiment, made when there is none.

    ``artifacts`` is where its files go; None, and any server that others share, leaves that to the
    MLflow server.
    """
    from mlflow.exceptions import MlflowException

    client = _client(tracking_uri)
    found = client.get_experiment_by_name(benchmark)
    if found is None:
        shared = tracking_uri.startswith("http")
        place = None if artifacts is None or shared else (artifacts.resolve() / benchmark).as_uri()
        try:
            tags = interface_view.experiment_tags()
            return str(client.create_experiment(benchmark, place, tags))
        except MlflowException:  # another flow was faster
            found = client.get_experiment_by_name(benchmark)
            if found is None:
                raise
    if found.lifecycle_stage == "deleted":
        client.restore_experiment(found.experiment_id)
    view = interface_view.experiment_tags()[interface_view.VIEW_TAG]
    if found.tags.get(interface_view.VIEW_TAG) != view:  # of an earlier version of the project
        client.set_experiment_tag(found.experiment_id, interface_view.VIEW_TAG, view)
    return str(found.experiment_id)


def record(
    tracking_uri: str,
    experiment: str,
    row: Row,
    *,
    parameters: Mapping[str, Any],
    curve: Sequence[Mapping[str, float]] = (),
    files: Iterable[tuple[Path, str]] = (),
    training: str | None = None,
    final: bool = True,
) -> str:
    """Write a row to its run and return the run's id.

    ``parameters`` may be nested, they are flattened with dots. ``curve`` holds one mapping per
    step, each with ``step``. ``files`` are files or folders and the folder in the run that they go
    to (empty: the top). ``training`` is the key of the training, where there was one. The row that
    is stored names its run. A run whose row is not ``final`` is shown as running.
    """
    client = _client(tracking_uri)
    run_id = _run_of(client, experiment, row, training)
    before = _stored_row(client, run_id)
    run_content.log_changed(client, run_id, row)
    log_curve(tracking_uri, run_id, curve)
    if before is None:
        run_content.log_parameters(client, run_id, parameters)
        client.log_dict(run_id, dict(parameters), CONFIG_FILE)
    for local, place in files:
        log = client.log_artifacts if local.is_dir() else client.log_artifact
        log(run_id, str(local), place or None)
    if before is None or before.get("per_view") != row.get("per_view"):
        run_content.log_views(client, run_id, row.get("per_view") or [])
    if final:
        _end(client, run_id, row, before)
    else:
        _store_row(client, run_id, row, before)
        open_run(client, run_id)
    return run_id


def finish(tracking_uri: str, row: Row, before: Row) -> None:
    """Close the run of ``row``, which was recorded as ``before``: bring what is new since."""
    client, run_id = _client(tracking_uri), before["run_id"]
    run_content.log_changed(client, run_id, row)
    if _ended(row) != _ended(before):
        run_content.log_tags(client, run_id, _ended(row))
    _end(client, run_id, row, _stored_row(client, run_id))


def recorded(tracking_uri: str, experiment: str, row: Row, training: str | None) -> Row | None:
    """Return the row that the run of ``row`` holds already, None where there is none."""
    client = _client(tracking_uri)
    run_id = _find_run(client, experiment, row, training)
    return None if run_id is None else _stored_row(client, run_id)


def begin(
    tracking_uri: str,
    experiment: str,
    row: Row,
    parameters: Mapping[str, Any],
    *,
    training: str | None = None,
) -> str:
    """Open the run of an experiment that is under way, and return its id.

    Its row, recorded later with the same ``training``, finds the same run.
    """
    client = _client(tracking_uri)
    run_id = _run_of(client, experiment, row, training)
    open_run(client, run_id)
    run_content.log_parameters(client, run_id, parameters)
    return run_id


def log_curve(tracking_uri: str, run_id: str, curve: Sequence[Mapping[str, float]]) -> None:
    """Add the points of a training curve that the run does not have yet, in as few calls as can be.

    Points hold ``step`` and any numbers, and come in the order of their steps.
    """
    if not curve:
        return
    client = _client(tracking_uri)
    name = next(key for key in curve[0] if key != "step")
    known = client.get_metric_history(run_id, f"curve_{name}")
    last = max((metric.step for metric in known), default=-1)
    new = [point for point in curve if point["step"] > last]
    run_content.log_metrics(
        client, run_id, run_content.curve_metrics(new, time.time_ns() // 1_000_000)
    )


def rows(tracking_uri: str, benchmark: str) -> list[Row]:
    """Return the rows of a benchmark as they were recorded, newest first.

    Rows of runs that were interrupted, so that others finished what they began, come last. Raises
    :class:`InputError` that names the known benchmarks when there is none of this name.
    """
    client = _client(tracking_uri)
    found = client.get_experiment_by_name(benchmark)
    if found is None:
        known = ", ".join(benchmarks(tracking_uri)) or "none yet"
        raise InputError(f"no benchmark is called {benchmark!r}; known: {known}")
    ended: list[Row] = []
    others: list[Row] = []
    for run in _pages(client, found.experiment_id):
        whole = run.info.status in ("FINISHED", "FAILED")
        if not whole and not _has_row(client, run.info.run_id):
            continue  # at work, or killed before it had a row
        path = client.download_artifacts(run.info.run_id, ROW_FILE)
        row = json.loads(Path(path).read_text(encoding="utf-8"))
        checked_row(row, f"run {run.info.run_id}: {ROW_FILE}")
        (others if run.info.status == "KILLED" else ended).append(row)
    return ended + others


def _has_row(client: Any, run_id: str) -> bool:
    return any(file.path == ROW_FILE for file in client.list_artifacts(run_id))


def benchmarks(tracking_uri: str) -> list[str]:
    """Return the names of all recorded benchmarks."""
    found = _client(tracking_uri).search_experiments()
    return sorted(e.name for e in found if e.name != "Default")


def row_key(row: Mapping[str, Any]) -> str:
    """Identify a row: its place in the grid, its configuration, inputs and code.

    The same experiment run again has the same key, whatever came out.
    """
    provenance = row.get("provenance") or {}
    parts: dict[str, Any] = {name: row[name] for name in IDENTITY}
    parts |= {name: provenance.get(name) for name in ("config_digest", "code_version", "inputs")}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:32]


def experiment_key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Identify the place in a benchmark's grid, whatever code or photos it was run with."""
    return tuple(row[name] for name in IDENTITY)


def open_run(client: Any, run_id: str) -> None:
    """Show the run as running, and this process as the one that works on it."""
    client.set_tag(run_id, OWNER_TAG, run_owner.owner())
    client.update_run(run_id, status="RUNNING")


def _client(tracking_uri: str) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=tracking_uri)


def _run_of(client: Any, experiment: str, row: Row, training: str | None) -> str:
    """Return the row's own run, made when there is none, with its tags."""
    provenance = row.get("provenance") or {}
    tags = {name: str(row[name]) for name in TAGS}
    tags |= _ended(row) | {
        ROW_TAG: row_key(row),
        "code_version": str(provenance.get("code_version", "")),
        "git": str(provenance.get("git", "")),
        "config_digest": str(provenance.get("config_digest", "")),
    }
    tags |= {} if training is None else {TRAINING_TAG: training}
    run_id = _find_run(client, experiment, row, training)
    if run_id is None:
        name = f"{row['capture']} {row['condition']} seed {row['seed']}"
        return str(client.create_run(experiment, tags=tags, run_name=name).info.run_id)
    run_content.log_tags(client, run_id, tags)
    return run_id


def _stored_row(client: Any, run_id: str) -> Row | None:
    """Return the row that a run holds; it is stored last, so all else is there with it."""
    if not _has_row(client, run_id):
        return None
    path = client.download_artifacts(run_id, ROW_FILE)
    row: Row = json.loads(Path(path).read_text(encoding="utf-8"))
    return row


def _store_row(client: Any, run_id: str, row: Row, before: Row | None) -> None:
    """Store a row unless it is there, or there with what was measured later."""
    row = row | {"run_id": run_id}
    if before is not None:
        later = {k: (before.get(k) or {}) | (row.get(k) or {}) for k in ("metrics", "provenance")}
        if row | later == before:
            return
    client.log_dict(run_id, row, ROW_FILE)


def _end(client: Any, run_id: str, row: Row, before: Row | None) -> None:
    row = row | {"run_id": run_id}
    if row != before:
        client.log_dict(run_id, row, ROW_FILE)
    client.set_terminated(run_id, "FINISHED" if row["status"] == "finished" else "FAILED")


def _ended(row: Row) -> dict[str, str]:
    told = "; ".join(one["text"] for one in row.get("warnings") or ())
    return {"status": row["status"], "reason": str(row.get("reason") or ""), "warnings": told}


def _find_run(client: Any, experiment: str, row: Row, training: str | None) -> str | None:
    """Return the run of a row; of another training of the same row it is another one."""
    query = f"tags.`{ROW_TAG}` = '{row_key(row)}'"
    found = client.search_runs([experiment], filter_string=query)
    mine = [run for run in found if run.data.tags.get(TRAINING_TAG, training) == training]
    if training is None and not mine:  # it ended before it trained, where others got further
        mine = list(found)
    return str(mine[0].info.run_id) if mine else None


def _pages(client: Any, experiment: str) -> Iterable[Any]:
    token = None
    query = "tags.`mattgs.row` != ''"
    while True:
        page = client.search_runs(
            [experiment],
            filter_string=query,
            order_by=["attributes.start_time DESC"],
            page_token=token,
        )
        yield from page
        token = page.token
        if not token:
            return
