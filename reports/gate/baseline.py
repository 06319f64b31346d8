"""Baselines: rows that a gate compares with, in a file with a schema, a digest and a machine.

Version 3 (now)::

    {"schema": 3, "name": …, "protocol": 1, "rows": [...], "rows_digest": "sha256:…",
     "machine": {"cpu": …, "cpu_kind": …, "cores": …, "threads": …}, "calibration": seconds,
     "made_by": {"code_version": …, "git": …, "config_digest": …, "inputs": …, "digest": …},
     "noise": {metric: standard deviation, …}}

``rows_digest`` covers the rows, so that a number edited by hand is noticed; ``made_by.digest`` what
made them. Values of ``machine`` and ``made_by`` are lists of all that occur. ``calibration`` is the
median over rows of the fixed workload's seconds, null where no row has one. ``noise`` may be empty:
the gate then uses its own table.

Older versions are migrated when they are read. Version 2 kept code and commit under ``machine`` and
no calibration; version 1 held ``schema``, ``name`` and ``rows`` only.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from statistics import fmean, median
from typing import Any

from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row, is_name
from mattgs_ops.whole_file import write_text_whole
from reports.gate.compare import collected
from reports.gate.speed import MACHINE, seconds
from reports.rows.finite import infinite_scores
from reports.rows.schema import PROTOCOL, Row, cells, problems

SCHEMA = 3
FOLDER = Path(__file__).with_name("baselines")
DROPPED = ("artifacts", "seconds")  # say where things lay on one disk, not what came out
MADE_BY = ("code_version", "git", "config_digest", "inputs")
FIELDS: dict[str, Any] = {  # of this version, besides rows: their types
    "name": str,
    "protocol": int,
    "machine": dict,
    "made_by": dict,
    "calibration": int | float | None,
    "noise": dict,
    "rows_digest": str,
}
TRAIN_FIELDS = ("view", "split")  # training views matter by name only


@dataclass(frozen=True)
class Baseline:
    """A baseline in memory; ``noise`` by metric as ``tolerances.py`` means it."""

    name: str
    rows: tuple[Row, ...]
    machine: Mapping[str, Any] = field(default_factory=dict)
    made_by: Mapping[str, Any] = field(default_factory=dict)
    calibration: float | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    protocol: int = PROTOCOL

    def save(self, path: Path) -> None:
        """Write the file; the same baseline gives the same bytes."""
        document = {
            "schema": SCHEMA,
            "name": self.name,
            "protocol": self.protocol,
            "machine": dict(self.machine),
            "made_by": dict(self.made_by),
            "calibration": self.calibration,
            "noise": dict(self.noise),
            "rows_digest": digest(self.rows),
            "rows": list(self.rows),
        }
        text = json.dumps(document, indent=1, sort_keys=True, allow_nan=False)
        write_text_whole(path, text + "\n")


def make(rows: Sequence[Row], name: str, noise: Mapping[str, float] | None = None) -> Baseline:
    """Make a baseline of rows; raises :class:`InputError` listing what is wrong with them.

    Failed rows may be part of it: a cell that failed is then expected to fail, or is fixed. Rows
    that failed all together are none.
    """
    wrong = problems(rows) or infinite_scores(rows)
    if wrong or not any(row["status"] == "finished" for row in rows):
        reasons = sorted({f"failed: {row['reason']}" for row in rows if not wrong})
        listed = "\n".join(wrong or reasons) or "there are none"
        raise InputError(f"baseline {name}: rows cannot be used:\n{listed}")
    slim = [_slim(row) for cell in cells(rows) for row in cell.rows]
    machine, made_by, workload = _origin(slim)
    return Baseline(name, tuple(slim), machine, made_by, workload, dict(noise or {}))


def _origin(rows: Sequence[Row]) -> tuple[dict[str, Any], dict[str, Any], float | None]:
    """Return machine, what made the rows, and the fixed workload's seconds."""
    origins = [row.get("provenance") or {} for row in rows]

    def occurring(name: str) -> list[str]:
        values = (origin[name] for origin in origins if origin.get(name) is not None)
        return sorted({v if isinstance(v, str) else json.dumps(v, sort_keys=True) for v in values})

    made_by: dict[str, Any] = {name: occurring(name) for name in MADE_BY}
    made_by["digest"] = digest([made_by])
    workloads = [seconds((row.get("metrics") or {}).get("calibration")) for row in rows]
    workloads += [seconds(origin.get("calibration")) for origin in origins]
    measured = [value for value in workloads if value is not None]
    return (
        {name: occurring(name) for name in MACHINE},
        made_by,
        median(measured) if measured else None,
    )


def measured_noise(runs: Sequence[Sequence[Row]]) -> dict[str, float]:
    """Return the noise of each metric between runs of the same code, as ``tolerances.py`` means it.

    Every two runs are compared; per metric the root mean square of the changes of all cells and
    seeds, over √2: the noise of one seed in one cell. Numbers that are the same to the bit say that
    nothing rounded otherwise, and not by how little it could: they measure no noise.
    Raises :class:`InputError` when there is nothing to compare, or nothing differs.
    """
    squares: dict[str, list[float]] = {}
    compared = False
    for one, other in combinations(runs, 2):
        for number in collected(one, other)[1]:
            if number.tolerance.kind != "speed":
                compared = True
                changes = [change**2 for change, _ in number.by_seed.values() if change]
                if changes:
                    squares.setdefault(number.tolerance.metric, []).extend(changes)
    if not compared:
        raise InputError("noise: expected at least two comparable runs of the same benchmark")
    if not squares:
        raise InputError(
            "noise: expected runs that differ, such as of two kinds of processors; found the same "
            "numbers to the bit, which measure none"
        )
    return {
        name: round(math.sqrt(fmean(changes_squared) / 2), 6)
        for name, changes_squared in sorted(squares.items())
    }


def kept_noise(path: Path, name: str) -> dict[str, float]:
    """Return the noise that the baseline at ``path`` states, if it is one of the same name."""
    if not path.is_file():
        return {}
    old = load(path)
    return dict(old.noise) if old.name == name else {}


def committed(name: str) -> bool:
    """Whether a baseline of this name comes with the project."""
    return is_name(name) and (FOLDER / f"{name}.json").is_file()


def load(place: str | Path) -> Baseline:
    """Read a baseline by path, or by the name of a committed one; older schemas are migrated.

    Raises :class:`InputError` naming the file for anything that is not a baseline, comes from a
    newer schema, or was changed by hand.
    """
    path = Path(place)
    if is_name(str(place)) and not path.suffix and not path.is_file():
        path = FOLDER / f"{place}.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # no file, no UTF-8 or no JSON
        names = ", ".join(sorted(p.stem for p in FOLDER.glob("*.json"))) or "none"
        message = f"{path}: expected a readable baseline ({error}); committed ones: {names}"
        raise InputError(message) from error
    document = migrate(document, str(path))
    rows = tuple(document["rows"])
    if digest(rows) != document["rows_digest"]:
        raise InputError(f"{path}: its rows are not those it was made of (digest differs)")
    return Baseline(
        document["name"],
        rows,
        document["machine"],
        document["made_by"],
        document["calibration"],
        document["noise"],
        document["protocol"],
    )


def migrate(document: Any, where: str) -> dict[str, Any]:
    """Bring a document of any known schema to the present one.

    Raises :class:`InputError` naming ``where`` for what is no baseline.
    """
    if not isinstance(document, dict) or not isinstance(document.get("rows"), list):
        raise InputError(f"{where}: expected a baseline with `rows`")
    version = document.get("schema")
    if not isinstance(version, int) or not 1 <= version <= SCHEMA:
        raise InputError(f"{where}: expected schema 1 to {SCHEMA}, found {version!r}")
    _check_parts(document, where)
    while version < SCHEMA:
        document = _MIGRATIONS[version](document)
        version += 1
    migrated: dict[str, Any] = document
    missing = FIELDS.keys() - migrated.keys()
    if missing:
        raise InputError(f"{where}: expected {', '.join(sorted(missing))}, found none")
    odd = [name for name, kind in FIELDS.items() if not isinstance(migrated[name], kind)]
    if odd:
        found = ", ".join(f"`{name}` {migrated[name]!r}" for name in odd)
        raise InputError(f"{where}: expected values as of a baseline, found {found}")
    return migrated


def _check_parts(document: dict[str, Any], where: str) -> None:
    """Refuse rows and noise that neither migrations nor the gate can read."""
    for index, row in enumerate(document["rows"]):
        checked_row(row, f"{where}: row {index}")
        for name in ("metrics", "provenance"):
            if not isinstance(row.get(name), dict | None):
                found = type(row[name]).__name__
                raise InputError(
                    f"{where}: row {index}: `{name}`: expected an object, found {found}"
                )
    noise = document.get("noise", {})
    values = noise.values() if isinstance(noise, dict) else [None]
    if not all(isinstance(one, int | float) and math.isfinite(one) and one >= 0 for one in values):
        raise InputError(
            f"{where}: `noise`: expected a number of 0 or more for each metric, found {noise!r}"
        )
    try:
        digest([document])
    except ValueError as error:
        raise InputError(f"{where}: expected finite numbers alone: {error}") from error


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


def _from_2(document: dict[str, Any]) -> dict[str, Any]:
    """Version 2 mixed what made the rows with the machine; both are in the rows themselves."""
    machine, made_by, workload = _origin(document["rows"])
    origin = {"machine": machine, "made_by": made_by, "calibration": workload}
    return document | {"schema": 3} | origin


_MIGRATIONS = {1: _from_1, 2: _from_2}


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
