"""The promoted baselines in a report: which lines they are, and how far the others are from them.

A line that holds a promoted run is marked; every other cell that has a baseline is compared with
it. Nothing is judged here: margins, noise and what compares at all are the gate's business.
"""

from collections.abc import Mapping, Sequence

from reports.rows import columns, statistics
from reports.rows.groups import by_capture, condition_of
from reports.rows.schema import Cell, CellKey, Row, cells, held_out_views, key_of, refused
from reports.tables.formats import Entry, Group, Line, Table
from reports.tables.pairs import ratio_of
from reports.tables.tables import HOLE, PROMOTED

QUALITY = (("mask_psnr", "PSNR in mask", "db"), ("mask_ssim", "SSIM in mask", "ssim"))
RATIOS = (("size_mb", "Size ×"), ("time", "Time ×"), ("fps", "FPS ×"))


def mark(rows: Sequence[Row], baselines: Sequence[Row]) -> list[Row]:
    """Return the rows; those that are a baseline themselves say so under ``promoted``."""
    ids = {row["run_id"] for row in baselines if row.get("run_id")}
    plain = [{key: value for key, value in row.items() if key != "promoted"} for row in rows]
    return [row | {"promoted": True} if row.get("run_id") in ids else row for row in plain]


def promoted_table(rows: Sequence[Row], baselines: Sequence[Row]) -> Table | None:
    """Differences between cells and their baselines; None when there is nothing to compare."""
    promoted: dict[CellKey, list[Row]] = {}
    for row in refused(baselines):
        promoted.setdefault(key_of(row), []).append(row)
    selected = [cell for cell in cells(rows) if cell.finished and cell.key in promoted]
    if not selected:
        return None
    groups = [
        Group(label, tuple(_line(cell, promoted[cell.key]) for cell in members))
        for label, members in by_capture(selected)
    ]
    heads = (*(f"{label} Δ" for _, label, _ in QUALITY), *(label for _, label in RATIOS))
    keys = (*(f"{key}_difference" for key, _, _ in QUALITY), *(f"{k}_ratio" for k, _ in RATIOS))
    notes = (
        (
            "Held-out views, this report minus the promoted baseline of the cell, paired by view "
            "and seed, with the half width of the 95 % interval; ratios of means. The gate says "
            "which of it is a regression."
        ),
        "★ the baseline itself.",
    )
    columns_of = (*heads, "Baseline")
    return Table(
        "table-promoted",
        "Against the promoted baseline",
        columns_of,
        (*keys, "baseline"),
        tuple(groups),
        notes,
        "Condition",
    )


def _line(cell: Cell, theirs: Sequence[Row]) -> Line:
    runs = tuple(str(row["run_id"]) for row in cell.finished if row.get("run_id"))
    names = Entry(" ".join(str(row.get("run_id") or "–")[:8] for row in theirs))
    if all(row.get("promoted") for row in cell.finished):
        holes = tuple(HOLE for _ in (*QUALITY, *RATIOS))
        return Line(condition_of(cell), (*holes, names), runs, PROMOTED)
    quality = (_quality(cell.finished, theirs, key, kind) for key, _, kind in QUALITY)
    ratios = (_ratio(cell.finished, theirs, key) for key, _ in RATIOS)
    return Line(condition_of(cell), (*quality, *ratios, names), runs)


def _quality(ours: Sequence[Row], theirs: Sequence[Row], metric: str, kind: str) -> Entry:
    interval = statistics.paired(_views(ours, metric), _views(theirs, metric))
    if interval is None:
        return HOLE
    spread = columns.text(kind, interval.half) if interval.samples > 1 else ""
    text, mean = columns.signed_text(kind, interval.mean), interval.mean
    if not spread:
        return Entry(text, value=mean)
    return Entry(text, spread, value=mean, low=interval.low, high=interval.high)


def _views(rows: Sequence[Row], metric: str) -> Mapping[tuple[str, int], float]:
    return {
        (str(view["view"]), int(row["seed"])): float(view[metric])
        for row in rows
        for view in held_out_views(row)
        if view.get(metric) is not None
    }


def _ratio(ours: Sequence[Row], theirs: Sequence[Row], metric: str) -> Entry:
    ratio = ratio_of(ours, theirs, metric)
    if ratio is None:
        return HOLE
    return Entry(columns.text("ratio", ratio), value=ratio)
