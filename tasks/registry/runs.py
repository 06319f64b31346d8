"""Rows in MLflow: how a run is begun, updated and read back.

One MLflow experiment per benchmark, one flat run per row (nested runs break the comparison charts).
A run carries tags to group and filter by, the configuration as flat parameters, the row's metrics
under their plain names, the training curve as metrics ``curve_*`` by step, the load of the machine
as MLflow's ``system/*``, the capture as its dataset, and the per-view scores and the row itself as
artifacts. A row that is recorded again updates its run (``run_of_row``). What a run has is not
logged again.

A fresh SQLite database must be initialised once (:func:`initialise`) before several processes use
it: concurrent first use would corrupt it for good. It is made beside its place, under a lock, and
moved there when it is whole: whoever is killed meanwhile leaves nothing half made. As making its
tables takes seconds, an empty one is kept in the user's cache folder, and later ones are copies.
"""

import fcntl
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row
from mattgs_ops.store import user_cache
from mattgs_ops.whole_file import written_whole
from tasks.registry import interface_view, run_of_row
from tasks.registry.content import values
from tasks.registry.content.about import About
from tasks.registry.project import benchmark_name, experiment_name, is_ours
from tasks.registry.run_of_row import IDENTITY, RECORDED_TAG, ROW_FILE, ROW_TAG, Row

CONFIG_FILE = "config.json"
SQLITE = "sqlite:///"
NOTHING = About()
PLACE = "DELETE FROM experiments"  # MLflow's default one, which it makes anew where there is none


def initialise(tracking_uri: str) -> None:
    """Create the database's tables; raises :class:`InputError` when the place cannot be used."""
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        if tracking_uri.startswith(SQLITE):
            with _made_database(Path(tracking_uri.removeprefix(SQLITE))):
                _client(tracking_uri).search_experiments(max_results=1)
        else:
            _client(tracking_uri).search_experiments(max_results=1)
    except (MlflowException, SQLAlchemyError) as error:
        raise InputError(f"MLflow at {tracking_uri} cannot be used: {error}") from error


@contextmanager
def _made_database(file: Path) -> Iterator[None]:
    """Make an SQLite file with MLflow's tables where there is none, and hold others off."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.with_name(f"{file.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for left in file.parent.glob(f"{file.name}.*.part*"):  # whoever made it held this lock
            left.unlink(missing_ok=True)
        if not file.exists():
            with written_whole(file, by_many=True) as partial:
                partial.unlink(missing_ok=True)
                kept = f"mlflow-{version('mlflow')}"
                known = user_cache.copied_database(kept, partial)
                _client(f"{SQLITE}{partial}").search_experiments(max_results=1)
                if not known:
                    user_cache.keep_database(kept, partial, without=PLACE)
        yield


def open_benchmark(tracking_uri: str, benchmark: str, artifacts: Path | None) -> str:
    """Return the id of the benchmark's MLflow experiment, made when there is none.

    ``artifacts`` is where its files go; None, and any server that others share, leaves that to the
    MLflow server.
    """
    from mlflow.exceptions import MlflowException

    client = _client(tracking_uri)
    name = experiment_name(benchmark)
    found = client.get_experiment_by_name(name)
    if found is None:
        shared = tracking_uri.startswith("http")
        place = None if artifacts is None or shared else (artifacts.resolve() / name).as_uri()
        try:
            tags = interface_view.experiment_tags()
            return str(client.create_experiment(name, place, tags))
        except MlflowException:  # another flow was faster
            found = client.get_experiment_by_name(name)
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
    load: Sequence[Mapping[str, float]] = (),
    about: About = NOTHING,
    files: Iterable[tuple[Path, str]] = (),
    training: str | None = None,
    final: bool = True,
) -> str:
    """Write a row to its run and return the run's id.

    ``parameters`` may be nested, they are flattened with dots. ``curve`` and ``load`` hold one
    mapping per point, see :func:`log_curve` and :func:`log_load`. ``files`` are files or folders
    and the folder in the run that they go to (empty: the top). ``training`` is the key of the
    training, where there was one. The row that is stored names its run. A run whose row is not
    ``final`` is shown as running.
    """
    client = _client(tracking_uri)
    run = run_of_row.find_or_make(client, experiment, row, training, about)
    run_id = str(run.info.run_id)
    before = run_of_row.stored_row(client, run)
    values.log_changed(client, run, row)
    log_curve(tracking_uri, run_id, curve)
    log_load(tracking_uri, run_id, load)
    if before is None:
        values.log_parameters(client, run_id, parameters)
        client.log_dict(run_id, dict(parameters), CONFIG_FILE)
    for local, place in files:
        log = client.log_artifacts if local.is_dir() else client.log_artifact
        log(run_id, str(local), place or None)
    if before is None or before.get("per_view") != row.get("per_view"):
        values.log_views(client, run_id, row.get("per_view") or [])
    if final:
        run_of_row.end(client, run_id, row, before, about)
    else:
        run_of_row.store_row(client, run_id, row, before)
        run_of_row.open_run(client, run_id)
    return run_id


def finish(tracking_uri: str, row: Row, before: Row, about: About = NOTHING) -> None:
    """Close the run of ``row``, which was recorded as ``before``: bring what is new since."""
    client = _client(tracking_uri)
    run = client.get_run(before["run_id"])
    values.log_changed(client, run, row)
    run_of_row.update_state(client, run, row, about)
    run_of_row.end(client, run.info.run_id, row, run_of_row.stored_row(client, run), about)


def recorded(tracking_uri: str, experiment: str, row: Row, training: str | None) -> Row | None:
    """Return the row that the run of ``row`` holds already, None where there is none."""
    client = _client(tracking_uri)
    run = run_of_row.find(client, experiment, row, training)
    return None if run is None else run_of_row.stored_row(client, run)


def begin(
    tracking_uri: str,
    experiment: str,
    row: Row,
    parameters: Mapping[str, Any],
    *,
    about: About = NOTHING,
    training: str | None = None,
) -> str:
    """Open the run of an experiment that is under way, and return its id.

    Its row, recorded later with the same ``training``, finds the same run.
    """
    client = _client(tracking_uri)
    run = run_of_row.find_or_make(client, experiment, row, training, about)
    run_id = str(run.info.run_id)
    run_of_row.open_run(client, run_id)
    values.log_parameters(client, run_id, parameters)
    return run_id


def log_curve(tracking_uri: str, run_id: str, curve: Sequence[Mapping[str, float]]) -> None:
    """Add the points of a training curve that the run does not have yet, in as few calls as can be.

    Points hold ``step`` and any numbers, and come in the order of their steps.
    """
    client = _client(tracking_uri)
    new = values.new_points(client, run_id, curve, values.CURVE)
    now = time.time_ns() // 1_000_000
    values.log_metrics(client, run_id, values.point_metrics(new, values.CURVE, now))


def log_load(tracking_uri: str, run_id: str, load: Sequence[Mapping[str, float]]) -> None:
    """Add the samples of a machine's load that the run does not have yet, as system metrics.

    Samples hold ``step``, ``time`` (seconds since the epoch) and any numbers, and come in the
    order of their steps.
    """
    client = _client(tracking_uri)
    new = values.new_points(client, run_id, load, values.SYSTEM)
    values.log_metrics(client, run_id, values.point_metrics(new, values.SYSTEM))


def rows(tracking_uri: str, benchmark: str) -> list[Row]:
    """Return the rows of a benchmark as they were recorded, newest first.

    Rows of runs that were interrupted, so that others finished what they began, come last. Raises
    :class:`InputError` that names the known benchmarks when there is none of this name.
    """
    try:
        return rows_of(tracking_uri, experiment_name(benchmark))
    except UnknownExperimentError:
        known = ", ".join(benchmarks(tracking_uri)) or "none yet"
        raise InputError(f"no benchmark is called {benchmark!r}; known: {known}") from None


class UnknownExperimentError(InputError):
    """MLflow has no experiment of this name."""


def rows_of(tracking_uri: str, experiment: str) -> list[Row]:
    """Return the rows of the MLflow experiment of this name, as :func:`rows` does."""
    client = _client(tracking_uri)
    found = client.get_experiment_by_name(experiment)
    if found is None:
        raise UnknownExperimentError(f"MLflow has no experiment {experiment!r}")
    ended: list[Row] = []
    others: list[Row] = []
    for run in pages(client, found.experiment_id):
        closed = run.info.status in ("FINISHED", "FAILED")
        if not closed and not run_of_row.has_row(client, run):
            continue  # at work, or killed before it had a row
        row = run_of_row.read_json(client, run, ROW_FILE)
        checked_row(row, f"run {run.info.run_id}: {ROW_FILE}")
        (others if run.info.status == "KILLED" else ended).append(row)
    return ended + others


def all_rows(tracking_uri: str) -> list[Row]:
    """Return the rows of all MLflow experiments, those of other projects included.

    Raises :class:`InputError` naming the registry where it cannot be read.
    """
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        return [row for name in experiments(tracking_uri) for row in rows_of(tracking_uri, name)]
    except (MlflowException, SQLAlchemyError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"MLflow at {tracking_uri} cannot be read: {reason}") from error


def experiments(tracking_uri: str) -> list[str]:
    """Return the names of all MLflow experiments, those of other projects included."""
    found = _client(tracking_uri).search_experiments()
    return sorted(e.name for e in found if e.name != "Default")


def benchmarks(tracking_uri: str) -> list[str]:
    """Return the names of all recorded benchmarks of this project."""
    return [benchmark_name(name) for name in experiments(tracking_uri) if is_ours(name)]


def experiment_key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Identify the place in a benchmark's grid, whatever code or photos it was run with."""
    return tuple(row.get(name) for name in IDENTITY)


def _client(tracking_uri: str) -> Any:
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=tracking_uri)


def pages(client: Any, experiment: str) -> Iterable[Any]:
    """Yield the runs of a benchmark's experiments, newest first; not its summary."""
    token = None
    query = f"tags.`{ROW_TAG}` != ''"
    # a training from the store has the date of when it was done, not of when it was recorded
    order = [f"tags.`{RECORDED_TAG}` DESC", "attributes.start_time DESC"]
    while True:
        page = client.search_runs(
            [experiment],
            filter_string=query,
            order_by=order,
            page_token=token,
        )
        yield from page
        token = page.token
        if not token:
            return
