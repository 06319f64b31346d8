"""Warnings that rows carry: what a reader must know of a capture before believing its numbers.

A row's ``warnings`` are objects with ``about`` (what: masks, say), ``text`` (a clause) and
``serious``. A capture with a serious one gets no verdict. So does one of which a row was trained on
views that it is scored on.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from reports.rows.comparable import listed, trained_on_held_out
from reports.rows.schema import Row, capture_name

# A measured number: with decimals, and no part of a file's name
MEASURED = re.compile(r"(?<![\w.])\d+\.\d+(?![\w.]*\w)")


def warnings(rows: Sequence[Row]) -> list[str]:
    """Return all warnings of all rows as sentences, each once, with the capture's name.

    Those of one capture that differ in what was measured alone, as every training measures it
    anew, are one sentence with the range.
    """
    alike: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        for one in _of(row):
            note = " No verdict is given for it." if one["serious"] else ""
            text = f"{capture_name(row['capture'])}: {one['text']}.{note}"
            alike.setdefault((row["capture"], MEASURED.sub("#", text)), []).append(text)
    return [_merged(texts) for texts in alike.values()]


def _merged(texts: Sequence[str]) -> str:
    """Return one sentence for several that differ in measured numbers: 0.8–1.1."""
    numbers = iter(zip(*(MEASURED.findall(text) for text in texts), strict=True))

    def ranged(_: re.Match[str]) -> str:
        found = sorted(set(next(numbers)), key=float)
        return found[0] if len(found) == 1 else f"{found[0]}–{found[-1]}"

    return MEASURED.sub(ranged, texts[0])


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
