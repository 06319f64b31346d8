"""Whether two rows may be compared at all, and if not, why. Never "same" by default."""

from collections.abc import Mapping
from typing import Any

from reports.rows.schema import FIRST_PROTOCOL, Row, row_problems

Provenance = Mapping[str, Any]


def reasons(candidate: Row, baseline: Row) -> list[str]:
    """Return why the scores of two finished rows do not compare; an empty list lets them."""
    found = [f"candidate: {text}" for text in row_problems(candidate)]
    found += [f"baseline: {text}" for text in row_problems(baseline)]
    if found:
        return found
    ours, theirs = candidate.get("provenance") or {}, baseline.get("provenance") or {}
    for name, mine, other in (
        ("protocol", protocol_of(candidate), protocol_of(baseline)),
        ("configuration digest", ours.get("config_digest"), theirs.get("config_digest")),
    ):
        if mine != other or mine is None:
            found.append(f"{name}: baseline {_short(other)}, candidate {_short(mine)}")
    found += _inputs(ours, theirs)
    found += _views(candidate, baseline)
    return found


def protocol_of(row: Row) -> Any:
    """Return the version of what a row's numbers mean; rows from before it was noted have none."""
    return row.get("protocol", (row.get("provenance") or {}).get("protocol", FIRST_PROTOCOL))


def _inputs(ours: Provenance, theirs: Provenance) -> list[str]:
    mine, other = ours.get("inputs") or {}, theirs.get("inputs") or {}
    changed = sorted(
        name for name in mine.keys() | other.keys() if mine.get(name) != other.get(name)
    )
    return [f"other inputs: {', '.join(changed)}"] if changed else []


def _views(candidate: Row, baseline: Row) -> list[str]:
    """Compare the splits: the same views must be held out, and none of them trained on."""
    found = []
    held_out, trained = names(candidate, "test"), names(candidate, "train")
    leaked = sorted(held_out & trained)
    if leaked:
        found.append(f"held-out views were trained on: {_list(leaked)}")
    lost = sorted(names(baseline, "test") - held_out)
    added = sorted(held_out - names(baseline, "test"))
    if lost:
        found.append(f"held-out views are missing: {_list(lost)}")
    if added:
        found.append(f"other held-out views: {_list(added)}")
    before = names(baseline, "train")
    if before and trained and before != trained:
        found.append(f"other training views: {_list(sorted(before ^ trained))}")
    return found


def names(row: Row, split: str) -> set[str]:
    """Return the names of a row's views of one split."""
    return {str(view["view"]) for view in row["per_view"] if view["split"] == split}


def _list(items: list[str], most: int = 4) -> str:
    rest = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(items[:most]) + rest


def _short(value: Any) -> str:
    return "none" if value is None else str(value)[:12]
