"""The kernels under address and undefined-behaviour sanitizers, in a program without Python."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
BUILD_SECONDS, RUN_SECONDS = 600, 120


@pytest.mark.slow
def test_the_kernels_run_clean_under_sanitizers(tmp_path: Path) -> None:
    if shutil.which("cmake") is None:
        pytest.skip("no cmake on this machine")
    configure = ["cmake", "-S", str(ROOT), "-B", str(tmp_path), "-DMATTGS_SANITIZE=ON"]
    subprocess.run(configure, check=True, capture_output=True, timeout=BUILD_SECONDS)
    build = ["cmake", "--build", str(tmp_path), "--parallel", str(os.cpu_count() or 1)]
    subprocess.run(build, check=True, capture_output=True, timeout=BUILD_SECONDS)
    result = subprocess.run(
        [str(tmp_path / "engine_check")],
        check=False,
        capture_output=True,
        text=True,
        timeout=RUN_SECONDS,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "instruction sets agree" in result.stdout
