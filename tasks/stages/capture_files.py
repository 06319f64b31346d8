"""The digest of a capture: of the contents of all files that it consists of.

It goes by names relative to the capture's folder and by contents, never by dates or places: a
copied capture is the same one, an edited photo makes another.
"""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from mattgs_ops.capture.source import (
    BUNDLED_FOLDER,
    RENDERED_FILE,
    files_below,
    is_video,
    open_source,
)
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError
from mattgs_ops.store.digests import file_digest


def capture_digest(capture: CaptureConfig) -> str:
    """Return SHA-256 over all files of a capture.

    Raises :class:`InputError` when the capture cannot be read.
    """
    total = hashlib.sha256()
    try:
        for label, path in sorted(_files(capture)):
            total.update(_line(label, path))
        if capture.masks is not None:
            for path in sorted(files_below(capture.masks)):
                label = path.relative_to(capture.masks).as_posix()
                total.update(_line(f"own masks/{label}", path))
    except OSError as error:
        raise InputError(f"{capture.name}: a file cannot be read: {error}") from error
    return total.hexdigest()


def ids_digest(capture: CaptureConfig) -> str:
    """Return SHA-256 over a rendered capture's id maps, empty where it has none.

    They score small structures and train nothing, so that they are no part of what a capture is.
    """
    ids = None if is_video(capture) else open_source(capture).ids
    if ids is None or not ids.is_dir():
        return ""
    total = hashlib.sha256()
    for path in sorted(ids.iterdir()):
        total.update(_line(path.name, path))
    return total.hexdigest()


def _line(label: str, path: Path) -> bytes:
    """Return a file's name, of whatever bytes it is, and its digest."""
    return f"{label}\0{file_digest(path)}\n".encode("utf-8", "surrogateescape")


def _files(capture: CaptureConfig) -> Iterator[tuple[str, Path]]:
    """Yield label and path of each file, each once."""
    if is_video(capture):
        assert capture.path is not None
        yield "video", capture.path
        return
    root = BUNDLED_FOLDER / capture.name if capture.path is None else capture.path
    made = root / RENDERED_FILE  # it says how a capture was rendered; nothing else is read
    for path in {*open_source(capture).files(), *([made] if made.is_file() else [])}:
        yield Path(os.path.relpath(path, root)).as_posix(), path
