"""Whether two rows may be compared at all, and if not, why. Never "same" by default.

:func:`reasons` are about what was asked for, :func:`other_truth` about what scores are measured
against: the held-out views, their truth and their masks, compared by digest. Masks that stages of
the line make are outcomes, not inputs: a change of code moves them, and with them every score.
"""

from typing import Any

from reports.rows.schema import FIRST_PROTOCOL, Row, row_problems

# What scores hang on → how it is called; a row's ``digests`` hold them
DECISIVE = {"split": "the split", "masks": "the masks", "truth": "the truth"}
# Stages that may have changed it, the first whose own digest differs did; else the last one
CAUSES = {
    "split": ("prepare",),
    "masks": ("prepare", "segment", "agree", "evaluate"),
    "truth": ("prepare", "segment", "agree", "evaluate"),
}


def reasons(candidate: Row, baseline: Row) -> list[str]:
    """Return why the scores of two finished rows do not compare; an empty list lets them."""
    differences = [f"candidate: {text}" for text in row_problems(candidate)]
    differences += [f"baseline: {text}" for text in row_problems(baseline)]
    return differences or reasons_of_valid(candidate, baseline)


def reasons_of_valid(candidate: Row, baseline: Row) -> list[str]:
    """Return the same for rows that are known to be valid: looking takes half of the time."""
    ours, theirs = candidate.get("provenance") or {}, baseline.get("provenance") or {}
    differences = other_protocol(candidate, baseline)
    digests = ours.get("config_digest"), theirs.get("config_digest")
    differences += _unlike("configuration digest", *digests)
    differences += other_inputs(candidate, baseline) + leaks(candidate)
    return differences + other_views(candidate, baseline)


def other_protocol(candidate: Row, baseline: Row) -> list[str]:
    """Return which versions two rows' numbers are of, where they differ."""
    return _unlike("protocol", protocol_of(candidate), protocol_of(baseline))


def _unlike(name: str, candidate_value: Any, baseline_value: Any) -> list[str]:
    if candidate_value == baseline_value and candidate_value is not None:
        return []
    return [f"{name}: baseline {_short(baseline_value)}, candidate {_short(candidate_value)}"]


def other_truth(candidate: Row, baseline: Row) -> list[str]:
    """Return what the scores of two rows are measured against and differs, with the stage."""
    ours, theirs = candidate.get("digests") or {}, baseline.get("digests") or {}
    differences = []
    for name, called in DECISIVE.items():
        candidate_value, baseline_value = ours.get(name), theirs.get(name)
        if candidate_value is None or baseline_value is None:
            where = "candidate" if candidate_value is None else "baseline"
            differences.append(f"{called}: the {where} does not state its digest")
        elif candidate_value != baseline_value:
            stages = CAUSES[name]
            changed = (s for s in stages if ours.get(s) != theirs.get(s))
            stage = next(changed, stages[-1])
            values = f"baseline {_short(baseline_value)}, candidate {_short(candidate_value)}"
            differences.append(f"{called} changed in the stage {stage}: {values}")
    return differences


def protocol_of(row: Row) -> Any:
    """Return the version of what a row's numbers mean; rows from before it was noted have none."""
    return row.get("protocol", (row.get("provenance") or {}).get("protocol", FIRST_PROTOCOL))


def other_inputs(candidate: Row, baseline: Row) -> list[str]:
    """Return which inputs (photos, poses, masks that came along) two rows were not both made of."""
    candidate_value, baseline_value = (
        (row.get("provenance") or {}).get("inputs") or {} for row in (candidate, baseline)
    )
    changed = sorted(
        name
        for name in candidate_value.keys() | baseline_value.keys()
        if candidate_value.get(name) != baseline_value.get(name)
    )
    return [f"other inputs: {', '.join(changed)}"] if changed else []


def trained_on_held_out(row: Row) -> list[str]:
    """Return the names of held-out views that a row was trained on."""
    return sorted(names(row, "test") & trained_views(row)[0])


def leaks(row: Row) -> list[str]:
    """Say which held-out views a row was trained on, if any."""
    leaked = trained_on_held_out(row)
    return [f"held-out views were trained on: {listed(leaked)}"] if leaked else []


def other_views(candidate: Row, baseline: Row) -> list[str]:
    """Compare the splits: the same views must be held out, and the same trained on."""
    differences = []
    held_out, held_out_before = names(candidate, "test"), names(baseline, "test")
    trained, all_of_them = trained_views(candidate)
    lost = sorted(held_out_before - held_out)
    added = sorted(held_out - held_out_before)
    if lost:
        differences.append(f"held-out views are missing: {listed(lost)}")
    if added:
        differences.append(f"other held-out views: {listed(added)}")
    before, all_before = trained_views(baseline)
    other = before ^ trained
    if all_of_them != all_before:  # a sample lies within all of them
        other = trained - before if all_before else before - trained
    if before and trained and other:
        differences.append(f"other training views: {listed(sorted(other))}")
    return differences


def trained_views(row: Row) -> tuple[set[str], bool]:
    """Return the names of photos that a row was trained on, and whether these are all.

    Rows of earlier versions name only those that were scored, which may be a sample.
    """
    listed = row.get("trained_on") or []
    return (set(listed), True) if listed else (names(row, "train"), False)


def names(row: Row, split: str) -> set[str]:
    """Return the names of a row's views of one split."""
    return {str(view["view"]) for view in row["per_view"] if view["split"] == split}


def listed(items: list[str], most: int = 4) -> str:
    """Name the first few."""
    rest = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(items[:most]) + rest


def _short(value: Any) -> str:
    return "none" if value is None else str(value)[:12]
