"""What this project keeps in the user's cache folder: nothing that cannot be made again.

``$XDG_CACHE_HOME/mattgs``, or ``~/.cache/mattgs``. Whoever may not write there goes without.
"""

import json
import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from mattgs_ops.whole_file import written_whole

FAILURES = (OSError, RuntimeError, sqlite3.Error)  # a user without a home has no cache either
PATIENCE_SECONDS = 1.0  # while another process writes


def folder() -> Path:
    """Return the cache folder, there or not; raises :class:`RuntimeError` without a home."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "mattgs"


def copied_database(name: str, database: Path) -> bool:
    """Start an SQLite file from the one kept under a name; False when there is none.

    One that a crash of the machine left damaged or empty is removed.
    """
    try:
        kept = folder() / f"{name}.db"
        with written_whole(database) as partial:
            shutil.copyfile(kept, partial)
            if not _is_whole(partial):
                kept.unlink()
                raise sqlite3.DatabaseError(f"{kept} is damaged")
    except FAILURES:
        return False
    return True


def _is_whole(database: Path) -> bool:
    """Whether an SQLite file has tables, and all of its pages."""
    try:
        with closing(sqlite3.connect(database)) as opened:
            (found,) = opened.execute("PRAGMA quick_check(1)").fetchone()
            tables = opened.execute("SELECT name FROM sqlite_master LIMIT 1").fetchone()
    except sqlite3.DatabaseError:
        return False
    return found == "ok" and tables is not None


def keep_database(name: str, database: Path, *, without: str = "") -> None:
    """Keep a database that nothing has been written to yet; without the right to, do nothing.

    ``without`` is SQL that removes from the kept one what holds in this place alone.
    """
    with suppress(*FAILURES):
        folder().mkdir(parents=True, exist_ok=True)
        with (
            written_whole(folder() / f"{name}.db", by_many=True) as partial,
            closing(sqlite3.connect(database)) as source,
            closing(sqlite3.connect(partial)) as target,
        ):
            source.backup(target)
            target.executescript(without)


class KeptValues:
    """JSON values by key in one file of the cache folder, for all processes of a user."""

    def __init__(self, name: str) -> None:
        self._name = f"{name}.db"

    def find(self, key: str) -> Any:
        """Return the value, None where there is none."""
        with suppress(*FAILURES, ValueError), self._table() as table:
            found = table.execute("SELECT value FROM kept WHERE key = ?", (key,)).fetchone()
            return None if found is None else json.loads(found[0])
        return None

    def keep(self, key: str, value: Any) -> None:
        """Keep a value; without the right to, or while others are busy there, do nothing.

        A file that is no database is begun anew.
        """
        with suppress(*FAILURES):
            folder().mkdir(parents=True, exist_ok=True)
            try:
                self._write(key, json.dumps(value))
            except sqlite3.OperationalError:  # busy, or not to be written
                raise
            except sqlite3.DatabaseError:
                (folder() / self._name).unlink()

    def _write(self, key: str, text: str) -> None:
        with self._table() as table:
            table.execute("PRAGMA synchronous=OFF")  # what is lost is made again
            table.execute("CREATE TABLE IF NOT EXISTS kept (key TEXT PRIMARY KEY, value TEXT)")
            table.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", (key, text))
            table.commit()

    @contextmanager
    def _table(self) -> Iterator[sqlite3.Connection]:
        with closing(sqlite3.connect(folder() / self._name, timeout=PATIENCE_SECONDS)) as table:
            yield table
