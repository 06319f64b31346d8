"""Where a number comes from: code, libraries, machine, threads.

Digests of files are in ``digests``, of code in ``code_version``.
"""

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

DISTRIBUTIONS = (
    "mattgs-bench",
    "numpy",
    "scipy",
    "torch",
    "pillow",
    "opencv-contrib-python-headless",
    "scikit-image",
    "pycolmap",
    "onnxruntime",
    "prefect",
    "dask",
    "mlflow",
)
VECTOR_UNITS = ("avx2", "avx512f", "asimd", "sve")
CPU_FILE = Path("/proc/cpuinfo")
PACKAGE = Path(__file__).resolve().parents[1]  # mattgs_ops
GIT_SECONDS = 10.0


def describe(threads: int) -> dict[str, Any]:
    """Return what a row's ``provenance`` says of this process: all values are JSON.

    ``threads`` is what the measured work used; ``cores`` what the process may run on; ``workload``
    the version of the calibration's fixed work.
    """
    from mattgs_ops.timing.calibration import VERSION

    return {
        "versions": versions(),
        "git": git_commit(),
        "cpu": cpu_model(),
        "cpu_kind": cpu_kind(),
        "cores": len(os.sched_getaffinity(0)),
        "threads": threads,
        "workload": VERSION,
        "platform": platform.platform(),
    }


def versions() -> dict[str, str]:
    """Return Python's version and those of the libraries that are installed."""
    found = {"python": platform.python_version()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def cpu_model(cpu_file: Path = CPU_FILE) -> str:
    """Return the processor's name as the kernel tells it, else its architecture."""
    try:
        lines = cpu_file.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        key, colon, value = line.partition(":")
        if colon and key.strip() == "model name" and value.strip():
            return value.strip()
    return platform.processor() or platform.machine()


def cpu_kind(cpu_file: Path = CPU_FILE) -> str:
    """Return what the name leaves open (hypervisors shorten it): family, model, vector units."""
    try:
        lines = cpu_file.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    found = {key.strip(): value.strip() for key, _, value in (x.partition(":") for x in lines)}
    flags = set(found.get("flags", found.get("Features", "")).split())
    vectors = [name for name in VECTOR_UNITS if name in flags]
    parts = [f"{name} {found[name]}" for name in ("cpu family", "model") if name in found]
    return " ".join([platform.machine(), *parts, *vectors])


def git_commit(package: Path = PACKAGE) -> str | None:
    """Return the commit that this package's source is at, with ``+changes`` where it was edited.

    None for an installed package, also one that lies inside somebody else's repository.
    """
    if _git(package, "ls-files", "--error-unmatch", "__init__.py") is None:
        return None
    commit = _git(package, "rev-parse", "HEAD")
    if commit is None:
        return None
    changes = _git(package, "status", "--porcelain", "--untracked-files=no", "--", ".")
    return f"{commit}+changes" if changes else commit


def _git(folder: Path, *arguments: str) -> str | None:
    command = ["git", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=GIT_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired):  # no git, or a repository on a dead share
        return None
    return done.stdout.strip() if done.returncode == 0 else None
