"""The kernels under address and undefined-behaviour sanitizers, in a program without Python.

Building it takes long, so the build is kept in ``build/sanitizers``, and the next run compiles what
has changed since. ``make clean`` removes it.
"""

import fcntl
import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
BUILD = ROOT / "build" / "sanitizers"
BUILD_SECONDS, RUN_SECONDS = 600, 120


@pytest.mark.slow
def test_the_kernels_run_clean_under_sanitizers() -> None:
    if shutil.which("cmake") is None:
        pytest.skip("no cmake on this machine")
    BUILD.mkdir(parents=True, exist_ok=True)
    with (BUILD / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two test runs must not write the same objects
        run("cmake", "-S", ROOT, "-B", BUILD, "-DMATTGS_SANITIZE=ON")
        run("cmake", "--build", BUILD, "--parallel", os.cpu_count() or 1)
        result = subprocess.run(
            [BUILD / "engine_check"],
            check=False,
            capture_output=True,
            text=True,
            timeout=RUN_SECONDS,
        )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "instruction sets agree" in result.stdout


def run(*command: str | Path | int) -> None:
    words = [str(word) for word in command]
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=BUILD_SECONDS)
    assert done.returncode == 0, done.stdout + done.stderr
