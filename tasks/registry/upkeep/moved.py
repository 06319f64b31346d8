"""A registry whose folder was moved or copied: the files of its runs lie beside it, as before.

MLflow stores whole paths. Without a correction a moved folder would write where it was before, and
a copy would read, and clean away, the files of the original.
"""

import re
import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import quote, unquote

from mattgs_ops.store.cleaning import is_in_use
from mattgs_ops.store.store import Store
from tasks.stages.stage import Place

DATABASE, ARTIFACTS = "mlflow.db", "mlflow-artifacts"  # of an output folder
PLACE = re.compile(rf"(file://.*/{ARTIFACTS})/(.+)")  # of an experiment's files, and which
COLUMNS = (  # of MLflow's tables, which hold such paths or what begins with one
    ("experiments", "artifact_location"),
    ("runs", "artifact_uri"),
    ("logged_models", "artifact_location"),
    ("model_versions", "source"),
    ("model_versions", "storage_location"),
)


def correct_places(out: Path) -> bool:
    """Let the registry in ``out`` name the files below ``out``; return whether it named others.

    Nothing is done while a benchmark runs there, perhaps in a container that calls the folder
    otherwise, nor where the files are not there: several folders may share a database.
    """
    database, artifacts = out / DATABASE, out / ARTIFACTS
    if not (database.is_file() and artifacts.is_dir()):
        return False
    here = artifacts.resolve().as_uri()
    address = f"file:{quote(str(database.resolve()))}?mode=rw"
    # one that is locked, read-only, or none of MLflow's: MLflow says so
    with suppress(sqlite3.Error), closing(sqlite3.connect(address, uri=True)) as connection:
        elsewhere = _places(connection, artifacts) - {here}
        if elsewhere and not is_in_use(Store(Place(out, "").store)):
            with connection:
                for old in elsewhere:
                    _replace(connection, old, here)
            return True
    return False


def _places(connection: sqlite3.Connection, artifacts: Path) -> set[str]:
    """Return the folders that are said to hold files of experiments which ``artifacts`` holds."""
    rows = connection.execute("SELECT artifact_location FROM experiments").fetchall()
    said = [found for (place,) in rows if (found := PLACE.fullmatch(place or ""))]
    return {one[1] for one in said if (artifacts / unquote(one[2])).is_dir()}


def _replace(connection: sqlite3.Connection, old: str, new: str) -> None:
    for table, column in COLUMNS:
        connection.execute(
            f"UPDATE {table} SET {column} = ? || substr({column}, ?) "
            f"WHERE substr({column}, 1, ?) = ?",
            (new, len(old) + 1, len(old) + 1, f"{old}/"),
        )
