"""``mattgs ui``: MLflow's web interface on the benchmark's runs."""

import os
import subprocess
import sys
from pathlib import Path

from flows.services import embedded
from mattgs_ops.errors import InputError, StageError


def serve(out: Path, port: int) -> None:
    """Serve until Ctrl-C; raises :class:`InputError` when nothing was recorded there."""
    if not os.environ.get("MLFLOW_TRACKING_URI") and not (out / "mlflow.db").is_file():
        raise InputError(
            f"{out}: no runs were recorded there; run `mattgs run` first, or --out DIR"
        )
    embedded.quieten(out)
    os.environ["MLFLOW_SERVER_ENABLE_JOB_EXECUTION"] = "false"  # starts in half the time
    command = [sys.executable, "-m", "mlflow", "server", "--workers", "1"]
    command += ["--host", "127.0.0.1", "--port", str(port)]
    command += ["--backend-store-uri", embedded.tracking_uri(out)]
    sys.stdout.write(
        f"MLflow: http://127.0.0.1:{port} (starting takes some seconds; Ctrl-C ends). "
        "In a benchmark, Views > Benchmark shows the tables' columns.\n"
    )
    sys.stdout.flush()
    code = subprocess.run(command, check=False).returncode
    if code not in (0, -2, 130):  # Ctrl-C reaches the server too
        raise StageError(f"MLflow's server ended with code {code}; is port {port} in use?")
