"""Tables that the paper does not print: what the methods were given, what it cost, which runs."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from reports.rows import budgets, clock, columns
from reports.rows.columns import Column
from reports.rows.doubts import doubted_note, in_doubt
from reports.rows.groups import by_capture, condition_of, finished_of
from reports.rows.schema import (
    BACKGROUNDS,
    Row,
    background_name,
    capture_name,
    cells,
    method_name,
    refused,
)
from reports.rows.settings import of_one_setting
from reports.tables import paper
from reports.tables.differences import difference_tables
from reports.tables.formats import Entry, Group, Line, Table
from reports.tables.origins import (
    machine_of,
    measured_on,
    origins_table,
    runs_table,
    shared_machine,
)
from reports.tables.tables import (
    HOLE,
    capture_tables,
    lines_of,
    make_table,
    mask_table,
    parts_table,
    perceptual_table,
    training_table,
)

BJONTEGAARD = (
    "Bjøntegaard's differences over the budgets: at equal PSNR how much larger a file, or how much "
    "longer a training, is than 3DGS's; at equal size how much higher the PSNR of held-out views; "
    "means over what both curves span, of points that bring more PSNR than all cheaper ones; of a "
    "method that takes no budget the distance of its one point from 3DGS's curve. In "
    "brackets 95 % intervals over captures, bold where they exclude zero. – where the curves have "
    "less than a quarter of their span in common; a mean over fewer captures than were run says "
    "over how many, and leaves out those that differ most."
)
BUDGETS = "table-budgets"  # of methods at equal sizes: a report that has it begins with it
RESUMED = (
    "A training that was resumed, and of which only the seconds of the last part are known, counts "
    "in no mean of Train; – where there is no other."
)
STAGES = {
    "prepare": "Prepare",
    "segment": "Segment",
    "sfm": "SfM",
    "agree": "Masks agree",
    "train": "Train",
    "evaluate": "Evaluate",
}


def budget_table(rows: Sequence[Row]) -> Table | None:
    """Say what methods gain over 3DGS at equal size and time; None where none has budgets."""
    if not budgets.has_budgets(rows):
        return None
    timer = clock.clock_of(rows)
    one_machine = len({machine_of(row) for row in rows if row["status"] == "finished"}) == 1
    shown: list[tuple[str, str, str]] = []  # cost, metric, heading
    for metric, part in budgets.parts(rows).items():
        shown.append(("size_mb", metric, f"Size at equal PSNR, {part}"))
        shown.append(("size_mb", metric, f"PSNR at equal size, {part}"))
        if one_machine and len(shown) == 2:
            word = "CPU time" if timer == clock.CPU else "Time"
            shown.append((timer, metric, f"{word} at equal PSNR, {part}"))
    gaps = [budgets.gaps(rows, cost, metric) for cost, metric, _ in shown]
    places = dict.fromkeys(place for found in gaps for place in found)
    groups: dict[str, list[Line]] = {}

    def add(group: str, method: str, mine: Collection[budgets.Compared]) -> None:
        entries = [
            _gap_entry([gap for place, gap in found.items() if place in mine], head)
            for found, (_, _, head) in zip(gaps, shown, strict=True)
        ]
        if any(entry is not HOLE for entry in entries):
            groups.setdefault(group, []).append(Line(method_name(method), tuple(entries)))

    doubted = in_doubt(rows)
    for background in BACKGROUNDS:
        for method in dict.fromkeys(name for _, own, name in places if own == background):
            mine = [p for p in places if p[1:] == (background, method) and p[0] not in doubted]
            add(f"{background_name(background)}, mean over captures", method, mine)
    for capture, background, method in places if len({place[0] for place in places}) > 1 else ():
        label = f"{capture_name(capture)}, {background_name(background)}"
        add(label, method, [(capture, background, method)])
    if not groups:
        return None
    return Table(
        BUDGETS,
        f"At equal size and time, against {method_name(budgets.BASE)}",
        tuple(head for _, _, head in shown),
        tuple(f"{m}_{head.split()[0].lower()}_{c}" for c, m, head in shown),
        tuple(Group(label, tuple(lines)) for label, lines in groups.items()),
        (BJONTEGAARD, *doubted_note(doubted)),
        with_runs=False,
    )


def _gap_entry(found: Sequence[budgets.Gap], heading: str) -> Entry:
    """Print a mean over captures: percent of cost, or decibels; bold beyond doubt."""
    quality = heading.startswith("PSNR")
    interval = budgets.mean_quality(found) if quality else budgets.mean_cost(found)
    if interval is None:
        return HOLE
    decimals, unit = (2, " dB") if quality else (0, " %")
    ends = (interval.mean, interval.low, interval.high)
    texts = [columns.signed(value, decimals) for value in ends]
    some = f", {interval.samples} of {len(found)}" if interval.samples < len(found) else ""
    if interval.samples < 2:
        return Entry(f"{texts[0]}{unit}{some}", value=interval.mean)
    text = f"{texts[0]}{unit} ({texts[1]} to {texts[2]}){some}"
    certain, mean = interval.excludes_zero(), interval.mean
    return Entry(text, best=certain, value=mean, low=interval.low, high=interval.high)


def quality_table(rows: Sequence[Row]) -> Table | None:
    """Show what the methods were given: registered views, sparse points, mask quality."""
    rows_of_table = (
        Column("registered", "Registered", +1, "text"),
        Column("missing", "Test views missing", -1, "text"),
        Column("keypoints", "Key points", 0, "text"),
        Column("masked", "In masks", 0, "text"),
        Column("matches", "Matches", 0, "text"),
        Column("points", "Sparse points", 0, "text"),
        Column("on_object", "On the object", 0, "text"),
        Column("mode", "SfM mode", 0, "text"),
        Column("source", "Masks from", 0, "text"),
        Column("mean_iou", "Mask IoU", +1, "text"),
    )
    groups = []
    for label, members in by_capture(cells(rows)):
        lines: dict[tuple[Entry, ...], Line] = {}
        for cell in members:
            for row in cell.finished[:1]:
                entries = _quality_entries(row)
                line = lines.get(entries) or Line(background_name(cell.key.background), entries)
                names = dict.fromkeys(
                    [*line.label.split(", "), background_name(cell.key.background)]
                )
                lines[entries] = Line(", ".join(names), entries)
        if lines:
            groups.append(Group(label, tuple(lines.values())))
    if not groups:
        return None
    notes = (
        (
            "A test view that SfM could not register is a failure of that view, not a smaller test "
            "set; mask IoU is known only where the exact mask is."
        ),
        *_incidents(rows),
    )
    heads = tuple(column.heading for column in rows_of_table)
    keys = tuple(column.key for column in rows_of_table)
    title = "Registration and masks"
    return Table("table-inputs", title, heads, keys, tuple(groups), notes, "Background", False)


def _incidents(rows: Sequence[Row]) -> list[str]:
    """Say, once per capture, which steps beyond the usual were taken and which views were lost."""
    sentences: dict[str, None] = {}
    for row in rows:
        registration, name = row.get("registration") or {}, capture_name(row["capture"])
        for step in registration.get("fallbacks") or ():
            sentences[f"{name}: {step}."] = None
        for view in registration.get("lost") or ():
            counts = f"{view['keypoints']} key points, {view['masked']} of them in its mask"
            why = f": it {view['reason']}" if view.get("reason") else ""
            sentences[f"{name}: {view['name']} was not registered{why}; it has {counts}."] = None
        reason = (registration.get("agreement") or {}).get("none")
        if reason:
            sentences[f"{name}: masks were not voted on: {reason}."] = None
    return list(sentences)


def _count(number: object) -> Entry:
    return (
        HOLE if not isinstance(number, int) else Entry(columns.text("count", number), value=number)
    )


def _quality_entries(row: Row) -> tuple[Entry, ...]:
    registration = row.get("registration") or {}
    masks = row.get("masks") or {}
    registered, total = registration.get("registered"), registration.get("views")
    iou, keypoints = masks.get("mean_iou"), registration.get("keypoints") or {}
    matches = registration.get("matches") or {}
    missing = registration.get("missing") or []
    return (
        HOLE if registered is None else Entry(f"{registered} of {total}", value=registered),
        Entry(str(len(missing)), value=len(missing)),
        _count(keypoints.get("original")),
        _count(keypoints.get("masked")),
        _count(sum(matches.values()) if matches else None),
        _count(registration.get("points")),
        _count(registration.get("object_points")),
        Entry(str(registration.get("mode") or "–")),
        Entry(str(masks.get("source") or "–")),
        HOLE if iou is None else Entry(columns.text("share", iou), value=iou),
    )


def cost_table(rows: Sequence[Row]) -> Table | None:
    """Seconds per stage as the run measured them, and the size of what came out."""
    selected = [cell for cell in cells(rows) if any(row.get("seconds") for row in cell.finished)]
    if not selected:
        return None
    taken = {stage for row in finished_of(selected) for stage in row.get("seconds") or {}}
    stage_columns = [
        Column(name, label, 0, "time") for name, label in STAGES.items() if name in taken
    ]
    holes: list[str] = []

    def values_of(row: Row, key: str) -> Any:
        return None if key == "train" and _resumed(row) else (row.get("seconds") or {}).get(key)

    groups = []
    printed: list[Row] = []
    for label, members in by_capture(selected):
        lines = lines_of(members, stage_columns, holes, condition_of, values_of)
        groups.append(Group(label, tuple(lines)))
        machine, done = shared_machine(members), finished_of(members)
        printed += measured_on(machine, done) if machine else done
    threads = sorted({str((_provenance(row)).get("threads", "?")) for row in printed})
    cpus = sorted({str(_provenance(row).get("cpu", "an unnamed CPU")) for row in printed})
    if any(_resumed(row) for row in printed):
        holes.append(RESUMED)
    notes = [
        *holes,
        (
            f"Wall time on {'; '.join(cpus)}; threads per training: {' or '.join(threads)}. "
            "Stages include start-up and reading; the column Time of the other tables is the "
            "training loop alone. A stage shared by several conditions or seeds ran once and is "
            "printed with each of them."
        ),
    ]
    return make_table("table-cost", "Cost per stage", stage_columns, groups, notes, "Condition")


def _resumed(row: Row) -> bool:
    """Whether a training was resumed and its stage's seconds are of its last part alone."""
    seconds = (row.get("seconds") or {}).get("train")
    return seconds is not None and seconds < float(row["metrics"]["time"])


def _provenance(row: Row) -> Mapping[str, Any]:
    return row.get("provenance") or {}


def all_tables(rows: Sequence[Row], values: paper.PaperValues | None = None) -> list[Table]:
    """List every table of a report, in the order in which it prints them."""
    rows = refused(rows)
    compared = of_one_setting(rows)
    extra = [
        mask_table(rows),
        parts_table(rows),
        perceptual_table(rows),
        *difference_tables(budgets.largest(compared)),
        training_table(rows),
        quality_table(rows),
        cost_table(rows),
        origins_table(rows),
        runs_table(rows),
    ]
    first = budget_table(compared)
    found = [] if first is None else [first]
    return found + capture_tables(rows, values) + [table for table in extra if table is not None]
