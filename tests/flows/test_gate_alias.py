"""A run that was promoted in the registry is a baseline by its alias."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch

from flows.gate import find_baseline, judge
from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.gaussians import Splats
from reports.gate import baseline
from tasks.registry import promotion, runs
from tasks.registry.lookup import find_run

Row = dict[str, Any]


@pytest.fixture
def out(fresh_registry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder whose registry holds a promoted run, and whose benchmark holds its row."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    row: Row = baseline.load("quick-ci").rows[0]
    shutil.copy(fresh_registry, tmp_path / "mlflow.db")
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    cloud = Splats.zeros(3)
    cloud.quaternions[:, 0] = 1.0
    cloud.means[:] = torch.eye(3)
    write_ply(cloud, tmp_path / "splats.ply")
    (tmp_path / "training.json").write_text(json.dumps({"background": (1.0, 1.0, 1.0)}))
    files = [(tmp_path / name, "") for name in ("splats.ply", "training.json")]
    experiment = runs.open_benchmark(uri, "quick-ci", tmp_path / "artifacts")
    run = runs.record(uri, experiment, row, parameters={}, files=files)
    promotion.promote(uri, find_run(uri, run))
    folder = tmp_path / "benchmarks" / "quick-ci"
    folder.mkdir(parents=True)
    (folder / "rows.json").write_text(json.dumps([row]))
    return tmp_path


def test_an_alias_is_a_baseline(out: Path) -> None:
    text, code = judge(out, "quick-ci", "baseline")
    assert code == 0, text
    known = find_baseline(out, "quick-ci", "baseline")
    assert known.name == "quick-ci@baseline"
    assert [row["condition"] for row in known.rows] == ["original-3dgs"]
    with pytest.raises(InputError, match=r"champion: expected .* an alias that runs of"):
        find_baseline(out, "quick-ci", "champion")
    with pytest.raises(InputError, match="'other' were promoted to"):
        find_baseline(out, "other", "baseline")
