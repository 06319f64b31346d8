"""Rows of one benchmark that came about in several sittings, put together; or refused, saying why.

Each part is a name (a file's) and its rows. Parts may overlap: the same experiment may stand in
several of them when it says the same everywhere, and one that failed gives way to one that
finished. Whatever would mix numbers that do not compare is an :class:`InputError` that names the
parts and the experiment: another benchmark, another protocol, other photos under one name, another
configuration or other values of one experiment.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from mattgs_ops.errors import InputError
from reports.rows.comparable import protocol_of
from reports.rows.schema import CellKey, Row, key_of, refused

Part = tuple[str, Sequence[Row]]
Identity = tuple[CellKey, int]


def merge(parts: Sequence[Part]) -> list[Row]:
    """Return the rows of all parts, each experiment once, in the order in which they come."""
    owned = [(name, row) for name, rows in parts for row in _usable(name, rows)]
    for what, value_of in (("benchmark", _benchmark), ("protocol", protocol_of)):
        _one_for_all(what, [(name, value_of(row)) for name, row in owned])
    _same_photos(owned)
    merged: dict[Identity, tuple[str, Row]] = {}
    for name, row in owned:
        identity = (key_of(row), int(row["seed"]))
        earlier = merged.get(identity)
        merged[identity] = (name, row) if earlier is None else _joined(earlier, (name, row))
    return [row for _, row in merged.values()]


def newest_alike(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """Return the rows that compare with the newest, and sentences on those that are left out.

    ``rows`` come newest first. Those of another protocol than the first one are left out, and those
    of other photos than the newest row of their capture.
    """
    photos: dict[str, Any] = {}
    kept: list[Row] = []
    older: dict[str, list[str]] = {}
    for row in rows:
        if protocol_of(row) != protocol_of(rows[0]):
            older.setdefault(f"another protocol ({protocol_of(row)})", []).append(_where(row))
        elif (digest := _photos(row)) != photos.setdefault(row["capture"], digest):
            older.setdefault("other photos", []).append(_where(row))
        else:
            kept.append(row)
    return kept, [
        f"Left out, as they are of {what} than the newest runs: {', '.join(names)}."
        for what, names in older.items()
    ]


def _where(row: Row) -> str:
    return f"{key_of(row)}, seed {row['seed']}"


def _photos(row: Row) -> Any:
    return ((row.get("provenance") or {}).get("inputs") or {}).get("capture")


def _usable(name: str, rows: Sequence[Row]) -> list[Row]:
    """Return a part's rows; those that cannot be used as failed ones that say why."""
    try:
        return refused(rows)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def _benchmark(row: Mapping[str, Any]) -> Any:
    return row.get("benchmark")


def _one_for_all(what: str, values: Sequence[tuple[str, Any]]) -> None:
    for name, value in values:
        first, expected = values[0]
        if value != expected:
            raise InputError(
                f"one report takes rows of one {what}: {first} has {expected!r}, "
                f"{name} has {value!r}"
            )


def _same_photos(owned: Sequence[tuple[str, Row]]) -> None:
    digests: dict[str, tuple[str, Any]] = {}
    for name, row in owned:
        digest = _photos(row)
        if digest is None:
            continue
        other, earlier = digests.setdefault(row["capture"], (name, digest))
        if earlier != digest:
            raise InputError(
                f"{name}: capture {row['capture']!r} has other photos than in {other} "
                f"({str(digest)[:12]}, there {str(earlier)[:12]})"
            )


def _joined(earlier: tuple[str, Row], other: tuple[str, Row]) -> tuple[str, Row]:
    """Return the one of two rows of one experiment that counts."""
    (first, one), (second, two) = earlier, other
    where = _where(one)
    mine, its = _config(one), _config(two)
    if mine != its and mine is not None and its is not None:
        raise InputError(
            f"{where}: other configurations in {first} ({mine[:12]}) and in {second} ({its[:12]})"
        )
    if two["status"] != "finished":
        return earlier if one["status"] == "finished" else other
    if one["status"] != "finished":
        return other
    differs = _difference(one, two)
    if differs:
        raise InputError(
            f"{where}: {first} and {second} do not agree on {differs}; it was run twice: leave one "
            "of the two rows out"
        )
    return earlier


def _config(row: Mapping[str, Any]) -> str | None:
    digest = (row.get("provenance") or {}).get("config_digest")
    return None if digest is None else str(digest)


def _difference(one: Row, two: Row) -> str:
    """Say what two finished rows of one experiment differ in; empty when they say the same."""
    mine, its = one["metrics"], two["metrics"]
    for metric in sorted(mine.keys() | its.keys()):
        if mine.get(metric) != its.get(metric):
            return f"{metric} ({mine.get(metric)}, {its.get(metric)})"
    return "scores per view" if one["per_view"] != two["per_view"] else ""
