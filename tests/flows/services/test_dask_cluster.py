"""The Dask cluster: ours by cores, an existing one over TLS, its workers checked beforehand."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import dask
import pytest
from distributed import Client, LocalCluster
from distributed.security import Security

from flows.services.dask_cluster import (
    CERTIFICATES,
    needed,
    start_forking,
    started,
    worker_count,
)
from mattgs_ops.config import RunConfig
from mattgs_ops.errors import InputError
from tasks.stages.stage import PACKAGE
from tests.flows.certificates import make_certificates

START_SECONDS = 90.0


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        (RunConfig(), 6),
        (RunConfig(threads=2), 3),
        (RunConfig(threads=4), 1),
        (RunConfig(threads=8), 1),
        (RunConfig(workers=9), 9),
    ],
)
def test_one_thread_per_core_that_is_ours_unless_set_otherwise(
    run: RunConfig, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flows.services.dask_cluster.own_cores", lambda: 6)
    assert worker_count(run) == expected


def test_a_training_takes_what_the_configuration_sets() -> None:
    assert needed(RunConfig()) == {"train": 1}
    assert needed(RunConfig(threads=4, memory=2e9)) == {"train": 1, "threads": 4, "memory": 2e9}


def test_our_own_workers_rest_while_their_stages_work(tmp_path: Path) -> None:
    with started(tmp_path, RunConfig(workers=1)) as cluster, Client(cluster.scheduler) as client:
        (calls,) = client.run(
            lambda dask_worker: {
                name: call.callback_time for name, call in dask_worker.periodic_callbacks.items()
            }
        ).values()
    assert "profile" not in calls
    assert min(calls.values()) >= 500, "milliseconds"


def test_workers_have_the_environment_of_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are forked from a process that has that of the first cluster."""
    start_forking()
    monkeypatch.setenv("MATTGS_TEST", "now")
    with started(tmp_path, RunConfig(workers=1)) as cluster, Client(cluster.scheduler) as client:
        (found,) = client.run(lambda: os.environ.get("MATTGS_TEST")).values()
    assert found == "now"


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere workers import for themselves")
def test_workers_import_for_themselves_where_a_socket_has_no_place(tmp_path: Path) -> None:
    program = "from flows.services import dask_cluster; print(dask_cluster.start_forking())"
    deep = tmp_path / ("deep" * 20)
    deep.mkdir()
    usual = {key: value for key, value in os.environ.items() if key != "TMPDIR"}
    printed = [
        subprocess.check_output([sys.executable, "-c", program], env=variables, text=True)
        for variables in (usual, usual | {"TMPDIR": str(deep)})
    ]
    assert printed == [
        "{'distributed.worker.multiprocessing-method': 'forkserver'}\n",
        "{}\n",
    ]


def test_ctrl_c_is_not_for_our_workers(tmp_path: Path) -> None:
    """A terminal sends it to all of its processes: the workers end with the cluster, in silence."""
    with started(tmp_path, RunConfig(workers=1)) as cluster, Client(cluster.scheduler) as client:
        (worker,) = client.run(os.getpid).values()
        os.kill(worker, signal.SIGINT)
        for _ in range(5):
            assert client.submit(os.getpid, pure=False).result(timeout=START_SECONDS) == worker
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set()), "for this one"


@pytest.fixture(scope="module")
def security(certificates: Path) -> Security:
    ca, cert, key = (str(certificates / file) for file in CERTIFICATES.values())
    roles = {
        f"tls_{role}_{n}": f
        for role in ("scheduler", "worker", "client")
        for n, f in (("cert", cert), ("key", key))
    }
    return Security(tls_ca_file=ca, require_encryption=True, **roles)


@pytest.fixture(scope="module")
def encrypted(security: Security) -> Iterator[LocalCluster]:
    """Run a scheduler that speaks TLS only, and a worker for one training at a time."""
    with LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tls://",
        host="127.0.0.1",
        security=security,
        dashboard_address="127.0.0.1:0",
        resources={"train": 1},
    ) as cluster:
        yield cluster


@pytest.fixture
def run(encrypted: LocalCluster, certificates: Path) -> RunConfig:
    return RunConfig(dask_scheduler=encrypted.scheduler_address, dask_certificates=certificates)


def test_an_encrypted_scheduler_runs_what_it_gets_and_names_its_dashboard(
    run: RunConfig, tmp_path: Path
) -> None:
    assert str(run.dask_scheduler).startswith("tls://127.0.0.1:")
    with started(tmp_path, run) as cluster, Client(cluster.scheduler) as client:
        assert client.submit(sum, [1, 2], resources=needed(run)).result() == 3
        assert str(cluster.dashboard).endswith("/status")
    assert dask.config.get("distributed.comm.tls.ca-file", None) is None, "put back at the end"


def test_dasks_own_configuration_may_name_the_certificates(
    run: RunConfig, certificates: Path, tmp_path: Path
) -> None:
    ca, cert, key = (str(certificates / file) for file in CERTIFICATES.values())
    values = {"ca-file": ca, "client.cert": cert, "client.key": key}
    with (
        dask.config.set({f"distributed.comm.tls.{name}": at for name, at in values.items()}),
        started(tmp_path, run.model_copy(update={"dask_certificates": None})) as cluster,
    ):
        assert cluster.scheduler == run.dask_scheduler


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"dask_certificates": None}, "expected certificates, by --dask-certificates DIR"),
        ({"dask_certificates": Path("/nowhere")}, "expected the file /nowhere/ca.pem"),
    ],
)
def test_certificates_that_do_not_fit_are_refused_by_name(
    run: RunConfig, change: dict[str, Any], says: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=says), started(tmp_path, run.model_copy(update=change)):
        pass


def test_a_certificate_of_another_authority_is_not_let_in(run: RunConfig, tmp_path: Path) -> None:
    own = run.model_copy(update={"dask_certificates": make_certificates(tmp_path)})
    with pytest.raises(InputError, match="no scheduler answers"), started(tmp_path, own):
        pass


@pytest.mark.parametrize(
    ("change", "asked"),
    [({"threads": 4}, "threads=4, train=1"), ({"memory": 2e9}, "memory=2e+09, train=1")],
)
def test_resources_that_no_worker_has_are_refused_with_the_command_that_starts_one(
    run: RunConfig, change: dict[str, Any], asked: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as error, started(tmp_path, run.model_copy(update=change)):
        pass
    assert f"expected a worker with the resources {asked}" in str(error.value)
    assert "found 1 workers with train=1" in str(error.value)
    command = f"dask worker {run.dask_scheduler} --tls-ca-file ca.pem --tls-cert cert.pem"
    assert command in str(error.value)
    assert f'--resources "{asked.replace(", ", " ")}"' in str(error.value)


def test_a_scheduler_without_workers_says_how_to_start_one(tmp_path: Path) -> None:
    with LocalCluster(
        n_workers=0, processes=False, protocol="tcp://", dashboard_address=None
    ) as cluster:
        run = RunConfig(dask_scheduler=cluster.scheduler_address)
        with (
            pytest.raises(InputError, match=r"no workers.*--resources \"train=1\""),
            started(tmp_path, run),
        ):
            pass


def test_a_worker_without_the_package_or_with_another_version_is_refused(
    encrypted: LocalCluster, run: RunConfig, certificates: Path, tmp_path: Path
) -> None:
    own = version(PACKAGE)
    packages = libraries_without_the_package(tmp_path / "libraries")
    with (
        worker(encrypted, certificates, packages, tmp_path),
        pytest.raises(InputError, match=rf"has no {PACKAGE}; this flow has {own}"),
        started(tmp_path, run),
    ):
        pass
    metadata = packages / "mattgs_bench-9.8.7.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text(f"Metadata-Version: 2.1\nName: {PACKAGE}\nVersion: 9.8.7\n")
    with (
        worker(encrypted, certificates, packages, tmp_path),
        pytest.raises(InputError, match=rf"has {PACKAGE} 9\.8\.7, this flow {own}"),
        started(tmp_path, run),
    ):
        pass


def libraries_without_the_package(folder: Path) -> Path:
    """Link all that is installed but this project into a folder."""
    folder.mkdir()
    installed = Path(dask.__file__).parents[1]
    for path in installed.iterdir():
        if "mattgs" not in path.name:
            (folder / path.name).symlink_to(path)
    return folder


@contextmanager
def worker(
    cluster: LocalCluster, certificates: Path, packages: Path, folder: Path
) -> Iterator[None]:
    """Run a worker process that imports from ``packages`` and nowhere else (-S: no site)."""
    command = [sys.executable, "-S", "-m", "dask", "worker", cluster.scheduler_address]
    command += ["--no-nanny", "--no-dashboard", "--nthreads", "1", "--resources", "train=1"]
    for name, file in CERTIFICATES.items():
        command += [f"--tls-{name}", str(certificates / file)]
    environment = os.environ | {"PYTHONPATH": str(packages)}
    with (
        (folder / "worker.log").open("ab") as log,
        subprocess.Popen(command, env=environment, cwd=folder, stdout=log, stderr=log) as process,
    ):
        try:
            with Client(cluster, set_as_default=False) as client:
                client.wait_for_workers(2, timeout=START_SECONDS)
            yield
        finally:
            process.terminate()
            process.wait()
            with Client(cluster, set_as_default=False) as client:
                end = time.monotonic() + START_SECONDS
                while len(client.scheduler_info(n_workers=-1)["workers"]) > 1:
                    assert time.monotonic() < end, "the worker is still there"
                    time.sleep(0.1)
