"""Bundled networks as ONNX Runtime has optimised them for this CPU, in the user's cache folder.

Optimising takes two seconds at each opening, six times what it takes to read what came out. That
holds for one version of ONNX Runtime on one kind of CPU, which its name says; its name also holds
the SHA-256 of its bytes, so that a damaged one is made anew. The outputs are the same to the bit.
"""

import platform
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mattgs_ops.store import user_cache
from mattgs_ops.store.digests import file_digest, json_digest

DIGEST_LETTERS = 32
UNUSED_DAYS = 90  # files that are so much older than one that is kept go: of earlier versions
CPU_FILE = Path("/proc/cpuinfo")


def open_optimized(path: Path, options: Callable[[], Any], like: object) -> Any:
    """Return an ONNX Runtime session of ``path``: of what is kept of it, which is kept else.

    ``options`` makes session options; ``like``, a JSON value, says what of them changes the
    optimised file. Where nothing can be kept the file is opened as any other; raises what ONNX
    Runtime does for one that it cannot read.
    """
    try:
        name = f"{path.stem}-{_made_for(path, like)[:DIGEST_LETTERS]}"
        kept = _find(name)
        return _keep(path, options(), name) if kept is None else _open_kept(kept, options())
    except Exception:  # whatever ONNX Runtime or the disk say of the cache
        return open_session(path, options())


def _made_for(path: Path, like: object) -> str:
    """Return the digest of all that the optimised file hangs on."""
    import onnxruntime

    found = [file_digest(path), onnxruntime.__version__, platform.machine(), cpu_flags(), like]
    return json_digest(found)


def cpu_flags(cpu_file: Path = CPU_FILE) -> str:
    """Return what the CPU can do, by which ONNX Runtime chooses; empty elsewhere than on Linux."""
    with suppress(OSError):
        text = cpu_file.read_text(encoding="utf-8", errors="replace")
        lines = text.splitlines()
        return next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return ""


def _find(name: str) -> Path | None:
    """Return the intact file of a name, None where there is none; removes damaged ones."""
    for kept in user_cache.folder().glob(f"{name}-*.onnx"):
        if kept == _place(name, file_digest(kept)):
            return kept
        kept.unlink()
    return None


def _place(name: str, digest: str) -> Path:
    return user_cache.folder() / f"{name}-{digest[:DIGEST_LETTERS]}.onnx"


def open_session(path: Path, options: Any) -> Any:
    """Return an ONNX Runtime session on the CPU; raises what ONNX Runtime does."""
    import onnxruntime

    return onnxruntime.InferenceSession(str(path), options, ["CPUExecutionProvider"])


def _open_kept(path: Path, options: Any) -> Any:
    from onnxruntime import GraphOptimizationLevel

    options.graph_optimization_level = GraphOptimizationLevel.ORT_DISABLE_ALL  # it was all done
    return open_session(path, options)


def _keep(path: Path, options: Any, name: str) -> Any:
    """Open ``path`` and keep what ONNX Runtime made of it."""
    cache = user_cache.folder()
    cache.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=cache) as folder:
        new = Path(folder) / path.name
        options.optimized_model_filepath = str(new)
        session = open_session(path, options)
        new.replace(_place(name, file_digest(new)))
    for old in cache.glob(f"{path.stem}-*.onnx"):
        if time.time() - old.stat().st_mtime > UNUSED_DAYS * 86400:
            old.unlink()
    return session
