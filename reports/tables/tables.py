"""Rows → tables: I–III as the paper prints them, and what the paper does not print.

Every number is the mean over a cell's finished seeds; the spread is the sample standard deviation
(n − 1) and appears from two seeds on. The best of a column within a row group is judged on the
rounded mean, so that what looks equal is equal; a group of one has no best. Where a group has both
backgrounds, each has its own best in columns that do not compare across them. Cells that failed
stay in the table as holes with a note.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean, stdev
from typing import Any

from mattgs_ops.naming import slug
from reports.rows import clock, columns
from reports.rows.columns import Column
from reports.rows.groups import by_capture, condition_of, finished_of, method_of
from reports.rows.schema import (
    Cell,
    CellKey,
    Row,
    background_name,
    capture_name,
    cells,
    method_name,
    refused,
)
from reports.tables import formats, paper
from reports.tables.formats import Entry, Group, Line, Table
from reports.tables.notes import (
    best_notes,
    length_notes,
    mask_notes,
    paper_notes,
    perceptual_notes,
    protocol_notes,
    where_timed,
)
from reports.tables.origins import Origin, machine_of, measured_on, shared_machine

HOLE = Entry("–")
SPEEDS = ("time", "rate")  # kinds of columns that depend on the machine
PROMOTED = " ★"  # on lines that hold a promoted run
CAPPED = " ‡"  # on lines that hold a run in which the cap of splats bound
MARK_NOTES = {
    PROMOTED: "★ promoted: the baseline of its cell.",
    CAPPED: "‡ the cap of splats (`train.max_splats`) bound: densification wanted more.",
}
MARKS = "abcdefghijklmnopqrstuvwxyz"


def terminal(rows: Sequence[Row]) -> str:
    """Tables I–III (and on) for a terminal: plain text, aligned, 80 columns at most."""
    return "\n".join(formats.plain(table) for table in capture_tables(refused(rows)))


def capture_tables(rows: Sequence[Row], values: paper.PaperValues | None = None) -> list[Table]:
    """One table per capture and setting: row groups Original and No BG, the seven columns."""
    values = paper.load() if values is None else values
    settings: dict[tuple[str, int, int], list[Cell]] = {}
    for cell in cells(rows):
        key = cell.key
        settings.setdefault((key.capture, key.iterations, key.resolution), []).append(cell)
    out = []
    for number, ((capture, iterations, resolution), selected) in enumerate(
        settings.items(), start=1
    ):
        title = f"{capture_name(capture)}: {iterations:,} iterations, longest side {resolution} px"
        beside = values if values.belong_to(iterations) else None
        groups, holes, quoted = _paper_groups(selected, beside)
        notes = [*holes, *protocol_notes(selected)]
        if quoted:
            notes += paper_notes(values)
        name = f"table-{number}-{slug(capture.lower(), keep='-_.')}"
        table = make_table(name, title, columns.PAPER, groups, notes)
        out.append(replace(table, number=columns.roman(number)))
    if out and values.values and not any(values.belong_to(key[1]) for key in settings):
        out[-1] = replace(out[-1], notes=(*out[-1].notes, *length_notes(values)))
    return out


def _paper_groups(
    selected: Sequence[Cell], values: paper.PaperValues | None
) -> tuple[list[Group], list[str], bool]:
    holes: list[str] = []
    groups = []
    quoted = False
    for background in dict.fromkeys(cell.key.background for cell in selected):
        members = [cell for cell in selected if cell.key.background == background]
        ours = lines_of(members, columns.PAPER, holes, method_of)
        lines = []
        for cell, line in zip(members, ours, strict=True):
            lines.append(line)
            theirs = (
                None
                if values is None or cell.key.budget
                else values.line(cell.key.capture, background, cell.key.method)
            )
            if theirs is not None:
                lines += [_quoted_line(cell.key, theirs), _difference_line(cell.key, line, theirs)]
                quoted = True
        groups.append(Group(background_name(background), tuple(lines)))
    return groups, holes, quoted


def _quoted_line(key: CellKey, theirs: Mapping[str, float]) -> Line:
    entries = [
        Entry(columns.text(c.kind, theirs[c.key]), value=theirs[c.key]) if c.key in theirs else HOLE
        for c in columns.PAPER
    ]
    return Line(f"{method_name(key.method)} (paper)", tuple(entries), quoted=True)


def _difference_line(key: CellKey, ours: Line, theirs: Mapping[str, float]) -> Line:
    """Ours minus the paper's, of means and at full precision, signed."""
    entries = []
    for column, entry in zip(columns.PAPER, ours.entries, strict=True):
        if entry.value is None or column.key not in theirs:
            entries.append(HOLE)
            continue
        difference = entry.value - theirs[column.key]
        entries.append(Entry(columns.signed_text(column.kind, difference), value=difference))
    return Line(f"{method_name(key.method)} − paper", tuple(entries), quoted=True)


def mask_table(rows: Sequence[Row]) -> Table | None:
    """In-mask scores; most of them compare across backgrounds."""
    title = "Inside the object's mask, held-out views"
    notes = mask_notes(finished_of(cells(rows)))
    return _conditions_table(rows, "table-in-mask", title, columns.IN_MASK, notes)


def parts_table(rows: Sequence[Row]) -> Table | None:
    """Scores of the object's core and of its rim; None for rows of protocol 1."""
    note = (
        "The core is the mask eroded by 5 pixels, the reach of SSIM's window: free of silhouettes. "
        "The rim is the rest of the mask, what is thinner than 11 pixels included."
    )
    title = "The object's core and rim, held-out views"
    return _conditions_table(rows, "table-core-and-rim", title, columns.CORE_AND_RIM, [note])


def perceptual_table(rows: Sequence[Row]) -> Table | None:
    """Scores of how different renderings look; None for rows that have none."""
    notes = perceptual_notes(finished_of(cells(rows)))
    title = "How different it looks, held-out views"
    return _conditions_table(rows, "table-perceptual", title, columns.PERCEPTUAL, notes)


def training_table(rows: Sequence[Row]) -> Table | None:
    """Scores of the views that were trained on: the paper's protocol, and its weighted terms."""
    note = (
        "Scores of the views that were trained on, which is the paper's protocol; they say how "
        "well a scene was memorised. L1 and Loss of eq. 15 weight each pixel by its attention, "
        "here for every method alike; they are on another scale than the plain ones."
    )
    return _conditions_table(rows, "table-training", "Training views", columns.TRAINING, [note])


def _conditions_table(
    rows: Sequence[Row],
    name: str,
    title: str,
    wanted: Sequence[Column],
    notes: Sequence[str],
) -> Table | None:
    """One line per condition, grouped by capture; only the columns that some row has."""
    selected = cells(rows)
    measured = {name for cell in selected for row in cell.finished for name in row["metrics"]}
    printed = [column for column in wanted if column.key in measured]
    if not printed:
        return None
    holes: list[str] = []
    groups = [
        Group(label, tuple(lines_of(members, printed, holes, condition_of)))
        for label, members in by_capture(selected)
    ]
    sentences = [*holes, *notes, *best_notes(selected, printed)]
    return make_table(name, title, printed, groups, sentences, "Condition")


def _metric(row: Row, key: str) -> Any:
    return row["metrics"].get(key)


def lines_of(
    members: Sequence[Cell],
    printed: Sequence[Column],
    holes: list[str],
    label: Callable[[Cell], str],
    value_of: Callable[[Row, str], Any] = _metric,
) -> list[Line]:
    """Build the lines of one group, mark the best entries, and add to the notes on holes."""
    machine, late = shared_machine(members), clock.clock_notes(finished_of(members))
    raw = [[_entry(cell, column, value_of, machine) for column in printed] for cell in members]
    mixed = len({machine_of(row) for row in finished_of(members)}) > 1
    if mixed and machine and any(column.kind in SPEEDS for column in printed):
        _add_once(holes, where_timed(members, machine))
    best = [
        set()
        if (mixed and not machine and column.kind in SPEEDS) or (column.key == clock.WALL and late)
        else _best(members, [entries[i] for entries in raw], column)
        for i, column in enumerate(printed)
    ]
    lines = []
    for place, (cell, entries) in enumerate(zip(members, raw, strict=True)):
        marked = [
            Entry(e.text, e.spread, place in best[i], e.value, e.deviation)
            for i, e in enumerate(entries)
        ]
        runs = tuple(str(row["run_id"]) for row in cell.rows if row.get("run_id"))
        star = PROMOTED if any(row.get("promoted") for row in cell.rows) else ""
        star += CAPPED if any(row.get("capped") for row in cell.rows) else ""
        lines.append(Line(label(cell), tuple(marked), runs, star + _hole_mark(cell, holes)))
    return lines


def _entry(
    cell: Cell, column: Column, value_of: Callable[[Row, str], Any], machine: Origin | None
) -> Entry:
    chosen = cell.finished
    if machine is not None and column.kind in SPEEDS:
        chosen = measured_on(machine, chosen)
    values = [value_of(row, column.key) for row in chosen]
    values = [float(v) for v in values if v is not None and math.isfinite(v)]
    if not values:
        return HOLE
    mean = fmean(values)
    once = column.kind == "time" and len(set(values)) == 1  # a stage that several rows share
    deviation = stdev(values) if len(values) > 1 and not once else None
    spread = "" if deviation is None else columns.text(column.kind, deviation)
    return Entry(columns.text(column.kind, mean), spread, False, mean, deviation)


def _add_once(notes: list[str], note: str) -> None:
    if note not in notes:
        notes.append(note)


def _best(members: Sequence[Cell], entries: Sequence[Entry], column: Column) -> set[int]:
    """Places of the best entries of one column, of each background where those do not compare.

    Equal texts share the honour.
    """
    comparing: dict[str, list[tuple[int, Entry]]] = {}
    for place, (cell, entry) in enumerate(zip(members, entries, strict=True)):
        if entry.value is not None:
            among = "both" if column.across else cell.key.background
            comparing.setdefault(among, []).append((place, entry))
    best: set[int] = set()
    for scored in comparing.values() if column.direction else ():
        top = max(scored, key=lambda item: column.direction * (item[1].value or 0.0))[1]
        winners = {place for place, entry in scored if entry.text == top.text}
        best |= winners if len(winners) < len(scored) else set()
    return best


def _hole_mark(cell: Cell, holes: list[str]) -> str:
    if not cell.failed:
        return ""
    mark = _letters(sum(text.startswith("(") for text in holes))
    reasons = "; ".join(dict.fromkeys(str(row.get("reason")) for row in cell.failed))
    seeds = ", ".join(str(row["seed"]) for row in cell.failed)
    where = f"{capture_name(cell.key.capture)}, {condition_of(cell)}"
    rest = f"; the line is the mean of the other {len(cell.finished)}" if cell.finished else ""
    holes.append(f"({mark}) {where}, seed {seeds} failed: {reasons}{rest}.")
    return f" ({mark})"


def _letters(number: int) -> str:
    """Return a, b … z, aa, ab … for 0, 1 …, as columns of a sheet are called."""
    before, last = divmod(number, len(MARKS))
    return (_letters(before - 1) if before else "") + MARKS[last]


def _mark_notes(groups: Sequence[Group]) -> list[str]:
    marks = "".join(line.marks for group in groups for line in group.lines)
    return [note for mark, note in MARK_NOTES.items() if mark in marks]


def make_table(
    name: str,
    title: str,
    printed: Sequence[Column],
    groups: Sequence[Group],
    notes: Sequence[str],
    first: str = "Method",
) -> Table:
    """Make a table whose headings and keys are those of its columns."""
    heads = tuple(column.heading for column in printed)
    keys = tuple(column.key for column in printed)
    sentences = (*notes, *_mark_notes(groups))
    return Table(name, title, heads, keys, tuple(groups), sentences, first)
