"""The Dask cluster that stages run on: our own, or an existing scheduler that is checked first.

A training takes resources of its worker (:func:`needed`). Dask lets a task wait for ever for
resources that no worker has, and runs a task on a worker with other code without a word. Hence an
existing scheduler's workers are looked at before anything is submitted: one of them must have the
resources, and all of them this package in this version.
"""

import logging
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import forkserver, resource_tracker
from pathlib import Path
from typing import Any

from mattgs_ops.config import RunConfig
from mattgs_ops.errors import InputError
from tasks.stages.cores import own_cores
from tasks.stages.stage import PACKAGE, code_versions, own_version

WORKER_IMPORTS = "tasks.prefect_tasks"
CONNECT_SECONDS = 20.0  # to a scheduler that the user named
# What Dask calls an encrypted connection, and the files of ``--dask-certificates``
TLS = "tls://"
CERTIFICATES = {"ca-file": "ca.pem", "cert": "cert.pem", "key": "key.pem"}
ROLES = ("client", "scheduler", "worker")
# Stages are processes of their own: Dask's profiler would look a hundred times a second at threads
# that wait for them, and each event loop fifty times at itself: 6 % of a core for an idle cluster
IDLE = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    # it would stay in our own environment and slow down what draws the report by a third: memory
    # goes back to the system at once
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
}


@dataclass(frozen=True)
class Cluster:
    """A scheduler's address, and that of its dashboard where it has one."""

    scheduler: str
    dashboard: str | None


def needed(run: RunConfig) -> dict[str, float]:
    """Return the worker resources that one training takes.

    ``train`` bounds the trainings of a worker, ``threads`` and ``memory`` (bytes) those of a
    machine whose worker has many threads. The latter two count where they are set.
    """
    required: dict[str, float] = {"train": 1}
    if run.threads > 1:
        required["threads"] = run.threads
    if run.memory > 0:
        required["memory"] = run.memory
    return required


def worker_count(run: RunConfig) -> int:
    """Return how many stages run at a time: as set, else no more threads than cores of ours."""
    return run.workers or max(1, own_cores() // run.threads)


@contextmanager
def started(out: Path, run: RunConfig) -> Iterator[Cluster]:
    """Yield a local cluster below ``out``, or the existing one of ``run.dask_scheduler``.

    Raises :class:`InputError` where that one cannot be used, before anything is submitted.
    """
    if run.dask_scheduler is not None:
        with _certificates(run):
            yield _existing(run.dask_scheduler, run)
        return
    with _spared_ctrl_c():
        forked = start_forking()
    import dask
    from distributed import LocalCluster

    retries = {"distributed.scheduler.allowed-failures": run.retries + 2}
    with dask.config.set(IDLE | forked | retries), _spared_ctrl_c():
        cluster = LocalCluster(
            n_workers=worker_count(run),
            threads_per_worker=1,
            processes=True,
            memory_limit=0,  # the work is done by subprocesses, which Dask does not see
            dashboard_address="127.0.0.1:0",
            local_directory=str(out / "dask"),
            silence_logs=logging.CRITICAL,
            preload=[WORKER_IMPORTS],  # else each worker's first stage waits for it
            resources=needed(run),
            env=dict(os.environ),  # forked by a process of an earlier environment, perhaps
        )
    try:
        yield Cluster(cluster.scheduler_address, cluster.dashboard_link)
    finally:
        cluster.close(timeout=10)


def start_forking() -> dict[str, str]:
    """Start the process that workers are forked from, which imports what they need.

    Each worker would take seconds for that. Returns what Dask must know of it: nothing where
    workers have to import for themselves, as libraries of the system may not bear a fork (elsewhere
    than on Linux), or as it cannot be reached (its socket lies in the temporary folder, whose path
    may be longer than a socket's can be).
    """
    if sys.platform != "linux":
        return {}
    forkserver.set_forkserver_preload(["distributed", WORKER_IMPORTS])
    try:
        forkserver.ensure_running()
    except OSError:
        return {}
    return {"distributed.worker.multiprocessing-method": "forkserver"}


@contextmanager
def _spared_ctrl_c() -> Iterator[None]:
    """Have what is started in this block never see Ctrl-C, which a terminal sends to all at once.

    Workers end when the cluster is closed; those that were hit would print how they died. Threads
    inherit which signals are blocked, and so do the processes that they start, now or later.
    """
    resource_tracker.ensure_running()  # which unblocks the signal in the thread that starts it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _certificates(run: RunConfig) -> Iterator[None]:
    """Have Dask use the certificates of ``run.dask_certificates``, else those of its configuration.

    Raises :class:`InputError` naming what is missing.
    """
    import dask

    address = str(run.dask_scheduler)
    encrypted = address.startswith(TLS)
    if run.dask_certificates is None:
        missing = [name for name in CERTIFICATES if not _configured(name)]
        if encrypted and missing:
            raise InputError(
                f"--dask-scheduler {address}: expected certificates, by --dask-certificates DIR "
                f"({', '.join(CERTIFICATES.values())}) or in Dask's configuration; found none for "
                f"{', '.join(missing)}"
            )
        yield
        return
    files = {name: run.dask_certificates / file for name, file in CERTIFICATES.items()}
    for path in files.values():
        if not path.is_file():
            raise InputError(f"--dask-certificates: expected the file {path}, found none")
    with dask.config.set(
        {"distributed.comm.tls.ca-file": str(files["ca-file"])}
        | {
            f"distributed.comm.tls.{role}.{name}": str(files[name])
            for role in ROLES
            for name in ("cert", "key")
        }
    ):
        yield


def _configured(name: str) -> object:
    import dask

    where = "ca-file" if name == "ca-file" else f"client.{name}"
    return dask.config.get(f"distributed.comm.tls.{where}", default=None)


def _existing(address: str, run: RunConfig) -> Cluster:
    """Connect to a scheduler, check its workers, return where it is."""
    from distributed import Client

    try:
        with Client(address, timeout=CONNECT_SECONDS, set_as_default=False) as client:
            workers = client.scheduler_info(n_workers=-1)["workers"]
            if not workers:
                raise InputError(
                    f"--dask-scheduler {address}: the scheduler has no workers; start some: "
                    f"{_command(address, run)}"
                )
            _check_resources(address, run, workers)
            _check_versions(address, client)
            return Cluster(address, _dashboard(client))
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--dask-scheduler {address}: no scheduler answers: {error}") from error


def _check_resources(address: str, run: RunConfig, workers: Mapping[str, Any]) -> None:
    """Raise :class:`InputError` unless a worker has what a training takes."""
    required = needed(run)
    offers = [worker.get("resources", {}) for worker in workers.values()]
    if any(all(offer.get(name, 0) >= required[name] for name in required) for offer in offers):
        return
    offered = sorted({_written(offer) or "none" for offer in offers})
    raise InputError(
        f"--dask-scheduler {address}: expected a worker with the resources {_written(required)}, "
        f"which one training takes; found {len(offers)} workers with {'; '.join(offered)}. "
        f"Start workers with: {_command(address, run)}"
    )


def _command(address: str, run: RunConfig) -> str:
    resources = _written(needed(run)).replace(", ", " ")
    files = " ".join(f"--tls-{name} {file}" for name, file in CERTIFICATES.items())
    tls = f"{files} " if address.startswith(TLS) else ""
    return f'dask worker {address} {tls}--nthreads 1 --resources "{resources}"'


def _written(resources: Mapping[str, float]) -> str:
    return ", ".join(f"{name}={value:g}" for name, value in sorted(resources.items()))


def _check_versions(address: str, client: Any) -> None:
    """Raise :class:`InputError` for the first worker that has not this package in this version.

    The first function that a worker runs must be there where the package is not.
    """
    own = own_version()
    versions = client.run(version, PACKAGE, on_error="return")
    for worker, answer in sorted(versions.items()):
        if isinstance(answer, PackageNotFoundError):
            raise InputError(
                f"--dask-scheduler {address}: the worker {worker} has no {PACKAGE}; this flow has "
                f"{own}. Install that version there"
            )
        if answer != own:
            raise InputError(
                f"--dask-scheduler {address}: the worker {worker} has {PACKAGE} {answer}, this "
                f"flow {own}. Install the same version"
            )
    codes = code_versions()
    for worker, answer in sorted(client.run(code_versions, on_error="return").items()):
        if isinstance(answer, Exception):
            raise InputError(
                f"--dask-scheduler {address}: the worker {worker} cannot load {PACKAGE} {own}: "
                f"{type(answer).__name__}: {answer}"
            )
        other = [stage for stage in codes if answer.get(stage) != codes[stage]]
        if other:
            stage = other[0]
            raise InputError(
                f"--dask-scheduler {address}: the worker {worker} has {PACKAGE} {own} with other "
                f"code than this flow: {stage} {str(answer.get(stage))[:12]}, here "
                f"{codes[stage][:12]}. Install the same commit"
            )


def _dashboard(client: Any) -> str | None:
    """Return the address of the scheduler's dashboard, None where it has none."""
    if "dashboard" not in client.scheduler_info()["services"]:
        return None
    link: str = client.dashboard_link
    return link
