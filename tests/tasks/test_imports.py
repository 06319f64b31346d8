"""What workers import before their first stage: a benchmark starts as fast as they do."""

import subprocess
import sys

import pytest

SLOW = ("torch", "scipy", "matplotlib", "mlflow", "onnxruntime", "pycolmap")  # a second each


@pytest.mark.parametrize("module", ["tasks.prefect_tasks", "mattgs_ops.segment.infer"])
def test_workers_and_segmentation_import_nothing_slow_that_they_do_not_need(module: str) -> None:
    code = f"import sys, {module}; print([m for m in {SLOW!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.strip() == "[]"
