"""Warnings that rows carry: what a reader must know of a capture before believing its numbers.

A row's ``warnings`` are objects with ``about`` (what: masks, say), ``text`` (a clause) and
``serious``. A capture with a serious one gets no verdict. So does one of which a row was trained on
views that it is scored on.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from reports.rows.comparable import listed, trained_on_held_out
from reports.rows.schema import Row, capture_name


def warnings(rows: Sequence[Row]) -> list[str]:
    """Return all warnings of all rows as sentences, each once, with the capture's name."""
    sentences: dict[str, None] = {}
    for row in rows:
        for one in _of(row):
            note = " No verdict is given for it." if one["serious"] else ""
            sentences[f"{capture_name(row['capture'])}: {one['text']}.{note}"] = None
    return list(sentences)


def in_doubt(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Return the captures that get no verdict, and what is in doubt: masks, poses."""
    subjects: dict[str, dict[str, None]] = {}
    for row in rows:
        for one in _of(row):
            if one["serious"]:
                subjects.setdefault(row["capture"], {})[str(one["about"])] = None
    return {name: list(about) for name, about in subjects.items()}


def doubted_note(doubted: Mapping[str, Sequence[str]]) -> list[str]:
    """Say which captures no mean counts; empty where all do."""
    if not doubted:
        return []
    names = ", ".join(
        f"{capture_name(name)} ({', '.join(about)})" for name, about in doubted.items()
    )
    return [f"Means over captures leave out those in doubt: {names}."]


def _of(row: Row) -> Sequence[Mapping[str, Any]]:
    warnings_of_row: Sequence[Mapping[str, Any]] = row.get("warnings") or ()
    leaked = trained_on_held_out(row)
    if not leaked:
        return warnings_of_row
    text = f"{row['condition']} was trained on held-out views, such as {listed(leaked)}"
    return [*warnings_of_row, {"about": "held-out views", "text": text, "serious": True}]
