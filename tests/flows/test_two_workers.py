"""A grid on a Dask scheduler with two workers that share nothing but the store and the servers."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKERS = ("worker-a", "worker-b")


@pytest.mark.slow
def test_two_workers_with_folders_of_their_own_do_a_grid_together(tmp_path: Path) -> None:
    """Real servers on loopback: S3, MLflow, Prefect, Dask; see the program that is run."""
    done = subprocess.run(
        [sys.executable, "benchmarks/two_machines.py", "--calm", "--folder", str(tmp_path)],
        cwd=ROOT,
        env=os.environ | {"TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=540,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    rows = json.loads((tmp_path / "flow/benchmarks/two-machines/rows.json").read_text())
    assert [row["status"] for row in rows] == ["finished", "finished"]
    assert all(row["run_id"] for row in rows)
    trained = {name: len(list((tmp_path / name).glob("logs/train-*.log"))) for name in WORKERS}
    assert trained == dict.fromkeys(WORKERS, 1), "each worker has trained"
    assert not list((tmp_path / "flow").glob("logs/train-*")), "and the flow's machine has not"
    for row in rows:
        splats = tmp_path / "flow" / "store" / row["artifacts"]["train"] / "splats.ply"
        assert splats.is_file(), "what was made elsewhere came through the store"
