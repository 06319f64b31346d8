"""Whether rows came about under one code on one machine, and what it means where they did not.

An **origin** is a state of the code on a kind of machine. A benchmark that was finished over
several sittings has several; its report has to say so, since times and speeds of different machines
do not compare, and conditions that started from different masks or poses differ by more than their
method.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from reports.rows.groups import by_capture, condition_of
from reports.rows.schema import Cell, Row, capture_name, captures, cells
from reports.tables.formats import Entry, Group, Line, Table

DIGEST = 12  # letters of a digest that tell two apart
Origin = tuple[str, ...]
MACHINE = ("cpu", "cpu_kind", "threads")
# What structure-from-motion and the masks report of their outcome, not of their time
SHARED = ("registered", "points", "object_points", "reprojection_error")


def origins(rows: Sequence[Row]) -> dict[Origin, list[Row]]:
    """Group finished rows by origin, in the order of the tables."""
    by_origin: dict[Origin, list[Row]] = {}
    for cell in cells(rows):
        for row in cell.finished:
            by_origin.setdefault(origin_of(row), []).append(row)
    return by_origin


def origin_of(row: Row) -> Origin:
    """Return what tells a row's origin from others."""
    return _code(row) + machine_of(row) + _libraries(row)


def machine_of(row: Row) -> Origin:
    """Return what tells the machine of a row from others.

    Cores count up to the training's threads: one thread is no faster for a second core, and how
    many cores a process may use is often a matter of how it was started.
    """
    origin = _provenance(row)
    cores, threads = origin.get("cores"), origin.get("threads")
    used = min(int(cores), int(threads)) if cores and threads else cores
    return (*(str(origin.get(name)) for name in MACHINE), str(used))


def cpu_of(row: Row) -> str:
    """Name a row's processor; with what tells generations of one brand apart, where it is known."""
    origin = _provenance(row)
    kind = origin.get("cpu_kind")
    return f"{origin.get('cpu') or '–'}{f' ({kind})' if kind else ''}"


def shared_machine(selected: Sequence[Cell]) -> Origin | None:
    """Return the machine whose times of these cells compare; None where no machine's do.

    It measured a row of every cell that has any; of several, the one that measured the most rows.
    """
    measured = [
        Counter(machine_of(row) for row in cell.finished) for cell in selected if cell.finished
    ]
    everywhere = [m for m in sum(measured, Counter()) if all(m in counts for counts in measured)]
    return max(everywhere, key=lambda m: (sum(counts[m] for counts in measured), m), default=None)


def measured_on(machine: Origin, rows: Sequence[Row]) -> tuple[Row, ...]:
    """Return the rows that a machine measured."""
    return tuple(row for row in rows if machine_of(row) == machine)


def notes(rows: Sequence[Row]) -> list[str]:
    """Say what a reader must know of rows with several origins; empty for one."""
    sentences = []
    finished = [row for row in rows if row["status"] == "finished"]
    codes = {_code(row) for row in finished}
    machines = {machine_of(row) for row in finished}
    if len(origins(rows)) > 1:
        parts = _counted(len(codes), "state of the code", "states of the code")
        parts += f" and {_counted(len(machines), 'kind of machine', 'kinds of machine')}"
        sentences.append(
            f"These rows come from several runs: {parts}; the table Origins names them."
        )
    if len(machines) > 1:
        sentences.append(
            "Time, FPS and cost per stage were measured on different machines and do not compare "
            "between them; tables print those of one machine where it measured every line, and "
            "ratios of times and speeds only where both conditions ran on one."
        )
    for name in captures(finished):
        sentences += _starts_note(name, [row for row in finished if row["capture"] == name])
    return sentences


def _starts_note(name: str, rows: Sequence[Row]) -> list[str]:
    """Say whether a capture's experiments started from different masks, poses or points.

    Conditions are compared seed by seed: what differs between seeds alone is in no difference.
    """
    by_seed: dict[int, set[str]] = {}
    for row in rows:
        by_seed.setdefault(int(row["seed"]), set()).add(repr(_start(row)))
    most, total = max(map(len, by_seed.values())), len(set().union(*by_seed.values()))
    text = ""
    if most > 1:
        text = (
            f"{capture_name(name)}: experiments of one seed started from {most} different sets of "
            "masks, poses or sparse points, so that a difference between conditions is not the "
            "method's alone."
        )
    elif total > 1:
        text = (
            f"{capture_name(name)}: seeds started from {total} different sets of masks, poses or "
            "sparse points, all conditions of a seed from the same."
        )
    return [text] if text else []


def origins_table(rows: Sequence[Row]) -> Table | None:
    """List the origins and how many experiments came from each; None where there is but one."""
    by_origin = origins(rows)
    if len(by_origin) < 2:
        return None
    differing = _differing(rows)
    groups = []
    for number, selected in enumerate(by_origin.values(), start=1):
        origin = _provenance(selected[0])
        versions = origin.get("versions") or {}
        commits = dict.fromkeys(
            str(_provenance(row).get("git") or "–")[:DIGEST] for row in selected
        )
        texts = (
            len(selected),
            str(origin.get("code_version") or "–")[:DIGEST],
            ", ".join(commits),
            cpu_of(selected[0]),
            ", ".join(sorted({str(_provenance(row).get("cores") or "–") for row in selected})),
            origin.get("threads") or "–",
            ", ".join(f"{name} {versions.get(name, '–')}" for name in differing) or "the same",
        )
        names = ", ".join(capture_name(name) for name in captures(selected))
        line = Line(names, tuple(Entry(str(text)) for text in texts))
        groups.append(Group(f"Origin {number}", (line,)))
    heads = ("Experiments", "Code", "Commit", "CPU", "Cores", "Threads", "Libraries")
    keys = tuple(head.lower() for head in heads)
    note = "Code is the digest of the stages' sources; libraries are listed where they differ."
    return Table(
        "table-origins", "Origins", heads, keys, tuple(groups), (note,), "Captures", with_runs=False
    )


def runs_table(rows: Sequence[Row]) -> Table | None:
    """Say where each line comes from: run, configuration, inputs; in full."""
    heads: tuple[str, ...] = ("Seed", "Status", "Run", "Config", "Code", "Inputs")
    numbers = {origin: str(number) for number, origin in enumerate(origins(rows), start=1)}
    if len(numbers) > 1:
        heads = (*heads, "Origin")
    groups = []
    for label, members in by_capture(cells(rows)):
        lines = []
        for cell in members:
            for row in cell.rows:
                origin = _provenance(row)
                inputs = origin.get("inputs") or {}
                texts: tuple[Any, ...] = (
                    row["seed"],
                    row["status"],
                    row.get("run_id") or "–",
                    str(origin.get("config_digest") or "–")[:DIGEST],
                    str(origin.get("code_version") or "–")[:DIGEST],
                    " ".join(f"{k}:{str(v)[:DIGEST]}" for k, v in sorted(inputs.items())) or "–",
                )
                texts = (*texts, numbers.get(origin_of(row), "–"))[: len(heads)]
                lines.append(Line(condition_of(cell), tuple(Entry(str(text)) for text in texts)))
        groups.append(Group(label, tuple(lines)))
    if not groups:
        return None
    keys = tuple(head.lower() for head in heads)
    return Table("table-runs", "Runs", heads, keys, tuple(groups), (), "Condition", False)


def _differing(rows: Sequence[Row]) -> list[str]:
    """Return the libraries that finished rows have in several versions."""
    recorded = [
        _provenance(row).get("versions") or {} for row in rows if row["status"] == "finished"
    ]
    names = sorted({name for versions in recorded for name in versions})
    return [name for name in names if len({versions.get(name) for versions in recorded}) > 1]


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"


def _provenance(row: Mapping[str, Any]) -> Mapping[str, Any]:
    return row.get("provenance") or {}


def _code(row: Row) -> Origin:
    return (str(_provenance(row).get("code_version")),)


def _libraries(row: Row) -> Origin:
    versions = _provenance(row).get("versions") or {}
    return tuple(f"{name} {versions[name]}" for name in sorted(versions))


def _start(row: Row) -> tuple[Any, ...]:
    registration, masks = row.get("registration") or {}, row.get("masks") or {}
    return (*(registration.get(name) for name in SHARED), masks.get("source"), masks.get("means"))
