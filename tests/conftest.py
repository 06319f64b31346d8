"""Shared by all tests: few threads, quiet libraries, real data where it lies beside the project."""

import os
import tempfile
from collections.abc import Iterator
from multiprocessing import util
from pathlib import Path

import pytest

# Before any numeric library starts its thread pools: tests run on two cores, and repeatably.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("DO_NOT_TRACK", "true")
os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("MPLBACKEND", "Agg")

REAL_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with slow tests first, so that processes that share the work end together."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def own_temporary_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep temporary files apart, and with them the locks that silence the machine.

    Neither other processes of the same test run nor benchmarks that run beside wait for them.
    """
    util.get_temp_dir()  # of multiprocessing's sockets: it removes that itself, when all has ended
    folder = str(tmp_path_factory.mktemp("temporary"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", folder)
        yield


@pytest.fixture(autouse=True)
def own_environment() -> Iterator[None]:
    """Put back the variables that a test's commands set, as each command is a process to users.

    A home of Prefect's below a test's folder would be named still when that folder is gone.
    """
    before = dict(os.environ)
    yield
    for key in os.environ.keys() - before.keys():
        del os.environ[key]
    os.environ.update(before)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real captures kept beside a checkout, never inside it; skips where absent."""
    if not REAL_DATA.is_dir():
        pytest.skip("no real captures beside this checkout (../shared/data)")
    return REAL_DATA


@pytest.fixture(scope="session")
def fresh_registry(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an MLflow database without runs, made once: to be copied, making one takes seconds."""
    from tasks.registry import runs

    path = tmp_path_factory.mktemp("registry") / "mlflow.db"
    runs.initialise(f"sqlite:///{path}")
    return path
