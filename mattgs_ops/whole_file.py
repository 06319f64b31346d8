"""Files that appear whole or not at all, whoever is killed while they are written.

What reads them never finds half a file; what writes them leaves nothing behind when it fails.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


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
    except BaseException:
        with suppress(OSError):  # the error before says more
            partial.unlink()
        raise
