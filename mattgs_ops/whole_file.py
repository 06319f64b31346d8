"""Files that appear whole or not at all, whoever is killed while they are written.

What reads them never finds half a file; what writes them leaves nothing behind when it fails.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mattgs_ops.errors import OF_THE_DISK


@contextmanager
def written_whole(path: Path, *, by_many: bool = False) -> Iterator[Path]:
    """Yield where to write; that becomes the file at ``path`` when the block ends without an error.

    ``by_many``: several processes may be writing it, each in a place of its own; the last wins.
    """
    own = f".{os.getpid()}" if by_many else ""
    partial = path.with_name(f"{path.name}{own}.part")
    try:
        yield partial
        partial.replace(path)
    except BaseException as error:
        if isinstance(error, OSError):
            unnamed = error.filename is None and error.errno in OF_THE_DISK  # as of a full disk
            if unnamed or str(error.filename) == str(partial):
                error.filename = str(path)  # which is what users know
        with suppress(OSError):  # the error before says more
            partial.unlink()
        raise


def write_text_whole(path: Path, text: str) -> None:
    """Write text as UTF-8 with plain line feeds, whole or not at all; folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
