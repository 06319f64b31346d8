"""The services that a benchmark needs, started beside it where none are configured.

Embedded default, everything below the output folder: a temporary Prefect server, MLflow on a SQLite
file, a Dask cluster of single-threaded worker processes. An API in Prefect's settings,
``MLFLOW_TRACKING_URI`` and a Dask scheduler's address name existing ones, which are used unchanged.
The flow does not know the difference.
"""

import fcntl
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO
from urllib.request import getproxies_environment

from flows.services import dask_cluster, prefect_settings, registries
from flows.services.background import Background, ends_at_once
from flows.services.prefect_server import PrefectServer
from mattgs_ops.config import RunConfig
from mattgs_ops.errors import InputError
from tasks.registry import runs
from tasks.registry.upkeep.moved import correct_places

QUIET = {
    # on the terminal failures are printed once, by the rows; the run's log has everything
    "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "CRITICAL",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "PREFECT_CLI_PROMPT": "false",
    "DASK_LOGGING__DISTRIBUTED": "critical",
    "DASK_DISTRIBUTED__WORKER__DAEMON": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    # seven tries with longer and longer pauses are four minutes a call, and there are many
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
    "MLFLOW_LOGGING_LEVEL": "CRITICAL",  # a warning of ours says what failed
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",  # a server's; else two lines per run
    "GIT_PYTHON_REFRESH": "quiet",
    # semaphores of a process that had no time to end well: they are removed
    "PYTHONWARNINGS": "ignore:resource_tracker:UserWarning",
}
OWN_MACHINE = ("127.0.0.1", "localhost")


@dataclass(frozen=True)
class Services:
    """Addresses of everything that the flow talks to."""

    prefect_api: str
    prefect_is_ours: bool
    tracking_uri: str
    dask_scheduler: str
    dask_dashboard: str | None

    def __str__(self) -> str:
        """Say in a line each which Prefect is used, and where Dask's dashboard is."""
        prefect = "a temporary server, as no API is configured" if self.prefect_is_ours else None
        lines = [f"Prefect: {prefect or self.prefect_api}"]
        if self.dask_dashboard is not None:
            lines.append(f"Dask: {self.dask_dashboard}")
        return "\n".join(lines)


def enter(out: Path) -> None:
    """Set the libraries' environment; call before Prefect, Dask or MLflow are imported.

    What the user has set stays as it is. A registry in ``out`` that was moved or copied with its
    folder names its own files from here on.
    """
    for key, value in QUIET.items():
        os.environ.setdefault(key, value)
    _reach_own_machine_directly()
    prefect_settings.use_own_home(out)
    correct_places(out)


def _reach_own_machine_directly() -> None:
    """Name this machine among what no proxy is asked for: our own services are here."""
    if not getproxies_environment():
        return
    spared = os.environ.get("no_proxy") or os.environ.get("NO_PROXY") or ""
    names = [name.strip() for name in spared.split(",") if name.strip()]
    if "*" not in names:
        names += [name for name in OWN_MACHINE if name not in names]
    # lower and upper case: which of the two counts, and where, differs among libraries
    os.environ["no_proxy"] = os.environ["NO_PROXY"] = ",".join(names)


def enter_existing(out: Path) -> None:
    """As :func:`enter`, for commands that read what runs have recorded; makes nothing without one.

    Raises :class:`InputError` where MLflow is a file that is not there: ``--out`` is mistyped.
    """
    if registries.existing(out) is None:
        file = registries.current(out).removeprefix(registries.SQLITE)
        raise InputError(
            f"{file}: expected what runs have recorded, found no such file; --out names the folder"
        )
    enter(out)


class Starting:
    """The services while they start: what takes long is begun on entering.

    Until they are ready Python collects no garbage. Dask logs each collection, wherever one falls:
    also within an import, where a thread holds the lock of all imports. Another thread that
    configures logging, as Prefect does, holds logging's lock and imports: neither would go on.

    Use as a context; everything of our own ends with it. Should our own Prefect server end before,
    the process exits with ``died``. Entering raises :class:`InputError` where
    the Prefect that the user named cannot be used, and :class:`StageError` where our own does not
    start.
    """

    def __init__(self, out: Path, run: RunConfig, died: int) -> None:
        self._out, self._died = out, died
        self._run = run
        self._tracking = registries.current(out)

    def __enter__(self) -> "Starting":
        api = prefect_settings.api_url()
        self._server: PrefectServer | None = None
        variables = {"MLFLOW_TRACKING_URI": self._tracking}
        with ExitStack() as stack:
            if api is None:
                self._server = stack.enter_context(_prefect_server(self._out))
                api = self._server.address()
                self._certificates = prefect_settings.certificates_for_own(self._server.home)
                variables["PREFECT_API_SSL_CERT_FILE"] = str(self._certificates)
            else:
                prefect_settings.check(api)
            # workers find them by it; set before there are threads
            stack.enter_context(_environment(**variables, PREFECT_API_URL=api))
            self._api, self._stack = api, stack.pop_all()
        gc.disable()
        self._mlflow = Background(lambda: runs.initialise(self._tracking))
        self._workers = Background(self._start_cluster)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End what is ours; where the process ends at once, do not wait for what is still starting.

        That ends with the process; what it left of a database the next run removes.
        """
        gc.enable()
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            sys.stderr.write("mattgs: interrupted; ending its services\n")
        if not ends_at_once(kind):
            self._mlflow.join()
            self._workers.join()
        self._stack.close()

    def _start_cluster(self) -> None:
        self._cluster = self._stack.enter_context(dask_cluster.started(self._out, self._run))

    def ready(self) -> Services:
        """Wait until all is up.

        Raises :class:`InputError` when a service that the user named does not answer, and
        :class:`StageError` when one of our own does not start.
        """
        self._workers.finish()
        if self._server is None:
            self._stack.enter_context(prefect_settings.using(self._api))
        else:
            own = prefect_settings.using_own(self._api, self._certificates)
            self._stack.enter_context(own)
        self._mlflow.finish()
        if self._server is not None:
            self._server.wait()
            self._server.follow(self._died)
        gc.enable()
        return Services(
            self._api,
            self._server is not None,
            self._tracking,
            self._cluster.scheduler,
            self._cluster.dashboard,
        )


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
