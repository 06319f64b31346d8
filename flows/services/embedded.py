"""The services that a benchmark needs, started beside it when none are named.

Embedded default, everything below the output folder: a temporary Prefect server, MLflow on a SQLite
file, a Dask cluster of single-threaded worker processes. ``PREFECT_API_URL``,
``MLFLOW_TRACKING_URI`` and a Dask scheduler's address name existing ones, which are used unchanged.
The flow does not know the difference.
"""

import fcntl
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from flows.services.prefect_server import PrefectServer
from mattgs_ops.config import RunConfig
from mattgs_ops.errors import InputError, StageError
from tasks.registry import runs

QUIET = {
    "PREFECT_LOGGING_LEVEL": "WARNING",
    "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "CRITICAL",  # failures are told once, by the rows
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "PREFECT_CLI_PROMPT": "false",
    "DASK_LOGGING__DISTRIBUTED": "critical",
    "DASK_DISTRIBUTED__WORKER__DAEMON": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_LOGGING_LEVEL": "CRITICAL",  # what fails is told once, by a warning of ours
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",  # a server's; else two lines per run
    "GIT_PYTHON_REFRESH": "quiet",
}
WORKER_IMPORTS = "tasks.prefect_tasks"
CONNECT_SECONDS = 20.0  # to a scheduler that the user named


@dataclass(frozen=True)
class Services:
    """Addresses of everything that the flow talks to."""

    prefect_api: str
    tracking_uri: str
    dask_scheduler: str
    dask_dashboard: str | None


def quieten(out: Path) -> None:
    """Set the libraries' environment; call before Prefect, Dask or MLflow are imported.

    What the user has set stays as it is.
    """
    for key, value in QUIET.items():
        os.environ.setdefault(key, value)
    if "PREFECT_HOME" not in os.environ:
        home = out / "prefect" / "client"
        home.mkdir(parents=True, exist_ok=True)  # Prefect warns where its parent is missing
        os.environ["PREFECT_HOME"] = str(home)


class Starting:
    """The services while they start: what takes long is begun on entering.

    Use as a context; everything of our own ends with it.
    """

    def __init__(self, out: Path, run: RunConfig) -> None:
        self._out = out
        self._run = run
        self._tracking = tracking_uri(out)
        self._stack = ExitStack()

    def __enter__(self) -> "Starting":
        self._api = os.environ.get("PREFECT_API_URL")
        self._server: PrefectServer | None = None
        if self._api is None:
            self._server = self._stack.enter_context(_prefect_server(self._out))
        self._mlflow = _Background(lambda: runs.initialise(self._tracking))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def ready(self) -> Services:
        """Wait until all is up.

        Raises :class:`InputError` when a service that the user named does not answer, and
        :class:`StageError` when one of our own does not start.
        """
        api = self._server.address() if self._server is not None else str(self._api)
        variables = {"PREFECT_API_URL": api, "MLFLOW_TRACKING_URI": self._tracking}
        self._stack.enter_context(_environment(**variables))
        scheduler, dashboard = self._stack.enter_context(_dask(self._out, self._run))
        self._stack.enter_context(_prefect_settings(api))
        self._mlflow.finish()
        if self._server is not None:
            self._server.wait()
            self._server.follow()
        return Services(api, self._tracking, scheduler, dashboard)


def tracking_uri(out: Path) -> str:
    """Return where MLflow is: as the environment says, else a SQLite file below ``out``."""
    own = f"sqlite:///{(out / 'mlflow.db').resolve()}"
    return os.environ.get("MLFLOW_TRACKING_URI") or own


class _Background(threading.Thread):
    """Run a function in a thread; :meth:`finish` waits and raises what it raised."""

    def __init__(self, function: Any) -> None:
        super().__init__(daemon=True)
        self._function = function
        self._error: Exception | None = None
        self.start()

    def run(self) -> None:
        try:
            self._function()
        except Exception as error:
            self._error = error

    def finish(self) -> None:
        self.join()
        if self._error is not None:
            raise self._error


@contextmanager
def _prefect_server(out: Path) -> Iterator[PrefectServer]:
    """Start a server on the first home that no other flow is using."""
    home, lock = _free_home(out / "prefect")
    server = PrefectServer(home, out / "logs" / f"{home.name}.log")
    try:
        yield server
    finally:
        server.stop()
        lock.close()


def _free_home(parent: Path) -> tuple[Path, IO[str]]:
    """Return the first of ``server-1``, ``server-2`` … that is not locked, and its lock."""
    number = 0
    while True:
        number += 1
        home = parent / f"server-{number}"
        home.mkdir(parents=True, exist_ok=True)
        lock = (home / "lock").open("w", encoding="utf-8")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        return home, lock


@contextmanager
def _environment(**values: str) -> Iterator[None]:
    """Set variables that worker processes inherit; put back what was there."""
    before = {key: os.environ.get(key) for key in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value


@contextmanager
def _prefect_settings(api: str) -> Iterator[None]:
    from prefect.settings import PREFECT_API_URL, temporary_settings

    with temporary_settings({PREFECT_API_URL: api}):
        yield


@contextmanager
def _dask(out: Path, run: RunConfig) -> Iterator[tuple[str, str | None]]:
    """Yield the scheduler's address and the dashboard's."""
    if run.dask_scheduler is not None:
        yield _existing_scheduler(run.dask_scheduler), None
        return
    import dask
    from distributed import LocalCluster

    settings = {"distributed.scheduler.allowed-failures": run.retries + 2}
    with dask.config.set(settings):
        cluster = LocalCluster(
            n_workers=worker_count(run),
            threads_per_worker=1,
            processes=True,
            memory_limit=0,  # the work is done by subprocesses, which Dask does not see
            dashboard_address="127.0.0.1:0",
            local_directory=str(out / "dask"),
            silence_logs=logging.CRITICAL,
            preload=[WORKER_IMPORTS],  # else each worker's first stage waits for it
        )
    try:
        yield cluster.scheduler_address, cluster.dashboard_link
    finally:
        cluster.close(timeout=10)


def worker_count(run: RunConfig) -> int:
    """Return how many stages run at a time: as asked, else no more threads than cores of ours."""
    cores = len(os.sched_getaffinity(0))  # a batch system or a container may give fewer than all
    return run.workers or max(1, cores // run.threads)


def _existing_scheduler(address: str) -> str:
    from distributed import Client

    try:
        with Client(address, timeout=CONNECT_SECONDS, set_as_default=False) as client:
            workers = client.scheduler_info(n_workers=-1)["workers"]
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--dask-scheduler {address}: no scheduler answers: {error}") from error
    if not workers:
        raise StageError(f"--dask-scheduler {address}: the scheduler has no workers")
    return address
