"""Baselines: rows that a gate compares with, in a file with a schema, a digest and a machine.

Version 2 (now)::

    {"schema": 2, "name": …, "protocol": 1, "rows": [...], "rows_digest": "sha256:…",
     "machine": {"cpu": …, "threads": …}, "noise": {metric: standard deviation, …}}

Version 1 held ``schema``, ``name`` and ``rows`` only; it is migrated when read. ``rows_digest``
covers the rows, so that a number edited by hand is noticed. ``noise`` may be empty: the gate then
uses its own table.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError
from reports.rows import PROTOCOL, Row, cells, problems

SCHEMA = 2
FOLDER = Path(__file__).with_name("baselines")
DROPPED = ("artifacts", "seconds")  # say where things lay on one disk, not what came out
TRAIN_FIELDS = ("view", "split")  # training views matter by name only


@dataclass(frozen=True)
class Baseline:
    """A baseline in memory; ``noise`` by metric as ``tolerances.py`` means it."""

    name: str
    rows: tuple[Row, ...]
    machine: Mapping[str, Any] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    protocol: int = PROTOCOL

    def save(self, path: Path) -> None:
        """Write the file; the same baseline gives the same bytes."""
        document = {
            "schema": SCHEMA,
            "name": self.name,
            "protocol": self.protocol,
            "machine": dict(self.machine),
            "noise": dict(self.noise),
            "rows_digest": digest(self.rows),
            "rows": list(self.rows),
        }
        text = json.dumps(document, indent=1, sort_keys=True, allow_nan=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8", newline="\n")


def make(rows: Sequence[Row], name: str, noise: Mapping[str, float] | None = None) -> Baseline:
    """Make a baseline of rows; raises :class:`InputError` listing what is wrong with them.

    Failed rows may be part of it: a cell that failed is then expected to fail, or is fixed.
    """
    wrong = problems(rows)
    if wrong or not rows:
        listed = "\n".join(wrong) or "there are none"
        raise InputError(f"baseline {name}: rows cannot be used:\n{listed}")
    slim = [_slim(row) for cell in cells(rows) for row in cell.rows]
    origins = [row.get("provenance") or {} for row in slim]
    machine = {
        key: sorted({str(origin[key]) for origin in origins if origin.get(key) is not None})
        for key in ("cpu", "threads", "code_version", "git")
    }
    return Baseline(name, tuple(slim), machine, dict(noise or {}))


def load(place: str | Path) -> Baseline:
    """Read a baseline by path, or by the name of a committed one; older schemas are migrated.

    Raises :class:`InputError` naming the file for anything that is not a baseline, comes from a
    newer schema, or was changed by hand.
    """
    path = Path(place)
    if not path.suffix and not path.is_file():
        path = FOLDER / f"{place}.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.json"))) or "none"
        message = f"{path}: expected a readable baseline ({error}); committed ones: {known}"
        raise InputError(message) from error
    document = migrate(document, str(path))
    rows = tuple(document["rows"])
    if digest(rows) != document["rows_digest"]:
        raise InputError(f"{path}: its rows are not those it was made of (digest differs)")
    return Baseline(
        document["name"], rows, document["machine"], document["noise"], document["protocol"]
    )


def migrate(document: Any, where: str) -> dict[str, Any]:
    """Bring a document of any known schema to the present one."""
    if not isinstance(document, dict) or not isinstance(document.get("rows"), list):
        raise InputError(f"{where}: expected a baseline with `rows`")
    version = document.get("schema")
    if not isinstance(version, int) or not 1 <= version <= SCHEMA:
        raise InputError(f"{where}: expected schema 1 to {SCHEMA}, found {version!r}")
    while version < SCHEMA:
        document = _MIGRATIONS[version](document)
        version += 1
    migrated: dict[str, Any] = document
    missing = {"name", "protocol", "machine", "noise", "rows_digest"} - migrated.keys()
    if missing:
        raise InputError(f"{where}: expected {', '.join(sorted(missing))}, found none")
    return migrated


def _from_1(document: dict[str, Any]) -> dict[str, Any]:
    """Version 1 said nothing of machine, noise or digest; its protocol was the first."""
    return document | {
        "schema": 2,
        "name": document.get("name", "unnamed"),
        "protocol": 1,
        "machine": {},
        "noise": {},
        "rows_digest": digest(document["rows"]),
    }


_MIGRATIONS = {1: _from_1}


def digest(rows: Sequence[Row]) -> str:
    """Return the digest of rows; NaN has none and is refused."""
    text = json.dumps(list(rows), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return "sha256:" + hashlib.sha256(text.encode("utf-8")).hexdigest()


def _slim(row: Row) -> Row:
    kept = {key: value for key, value in row.items() if key not in DROPPED}
    kept |= {"artifacts": {}}
    kept["per_view"] = [
        view if view["split"] == "test" else {name: view[name] for name in TRAIN_FIELDS}
        for view in row.get("per_view") or []
    ]
    return kept
