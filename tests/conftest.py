"""Shared by all tests: few threads, quiet libraries, real data where it lies beside the project."""

import os
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
