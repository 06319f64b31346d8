"""The digest of a capture: of the contents of all files that it consists of.

It goes by names relative to the capture's folder and by contents, never by dates or places: a
copied capture is the same one, an edited photo makes another.
"""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from mattgs_ops.capture.source import BUNDLED_FOLDER, is_video, open_source
from mattgs_ops.config import CaptureConfig
from mattgs_ops.store.digests import file_digest


def capture_digest(capture: CaptureConfig) -> str:
    """Return SHA-256 over all files of a capture.

    Raises :class:`InputError` when the capture cannot be read.
    """
    total = hashlib.sha256()
    for label, path in sorted(_files(capture)):
        total.update(f"{label}\0{file_digest(path)}\n".encode())
    if capture.masks is not None:
        for path in sorted(p for p in capture.masks.rglob("*") if p.is_file()):
            label = path.relative_to(capture.masks).as_posix()
            total.update(f"own masks/{label}\0{file_digest(path)}\n".encode())
    return total.hexdigest()


def _files(capture: CaptureConfig) -> Iterator[tuple[str, Path]]:
    """Yield label and path of each file, each once."""
    if is_video(capture):
        assert capture.path is not None
        yield "video", capture.path
        return
    root = BUNDLED_FOLDER / capture.name if capture.path is None else capture.path
    beside = (path for path in root.glob("*") if path.is_file())
    for path in {*open_source(capture).files(), *beside}:
        yield Path(os.path.relpath(path, root)).as_posix(), path
