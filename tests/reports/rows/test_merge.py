"""Rows of several sittings: what may be put together, what is refused, and what is told of it."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from reports.figures import trade_off
from reports.rows.merge import merge, newest_alike
from reports.rows.schema import PROTOCOL, Cell, cells
from reports.tables import notes, origins, pairs, tables, verdict
from tasks import row as made

Row = dict[str, Any]
MakeRow = Callable[..., Row]


def changed(row: Row, field: str, value: Any) -> Row:
    """Return a copy with ``a.b`` set."""
    out = copy.deepcopy(row)
    *path, last = field.split(".")
    place = out
    for name in path:
        place = place[name]
    place[last] = value
    return out


def test_parts_become_one_grid(make_grid: Callable[..., list[Row]]) -> None:
    rows = make_grid(seeds=2)
    assert merge([("a", rows[:5]), ("b", rows[5:])]) == rows


def test_the_same_row_twice_counts_once(make_row: MakeRow) -> None:
    row = make_row("rover", "nobg", "ours")
    elsewhere = changed(changed(row, "run_id", "f" * 32), "artifacts", {"train": "other"})
    assert merge([("a", [row]), ("b", [elsewhere])]) == [row]


def test_what_failed_gives_way_to_what_finished(make_row: MakeRow, make_failed: MakeRow) -> None:
    good, bad = make_row("rover", "nobg", "ours"), make_failed("rover", "nobg", "ours", "killed")
    later = make_failed("rover", "nobg", "ours", "out of memory")
    for parts in ([("a", [good]), ("b", [bad])], [("a", [bad]), ("b", [good])]):
        assert merge(parts) == [good]
    assert merge([("a", [bad]), ("b", [later])])[0]["reason"] == "out of memory"


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("metrics.psnr", 1.0, "do not agree on psnr (27"),
        ("per_view", [], "do not agree on scores per view"),
        ("provenance.config_digest", "decaf", "other configurations in a.json (c0ffee)"),
        ("provenance.inputs", {"capture": "d2"}, "other photos than in a.json"),
        ("protocol", 2, "rows of one protocol: a.json has 1, b.json has 2"),
        ("benchmark", "other", "rows of one benchmark: a.json has 'toy', b.json has 'other'"),
    ],
)
def test_what_does_not_belong_together_is_refused_by_name(
    make_row: MakeRow, field: str, value: Any, words: str
) -> None:
    row = make_row("rover", "nobg", "ours", 3)
    with pytest.raises(InputError) as caught:
        merge([("a.json", [row]), ("b.json", [changed(row, field, value)])])
    assert words in str(caught.value)
    assert "b.json" in str(caught.value)
    if "agree" in words or "configurations" in words:
        assert "rover/nobg-ours@1000x320, seed 3" in str(caught.value)


def test_protocol_and_photos_are_compared_across_experiments(make_row: MakeRow) -> None:
    one, two = make_row("rover", "nobg", "3dgs"), make_row("rover", "nobg", "ours")
    for other in (two | {"protocol": 2}, changed(two, "provenance.inputs", {"capture": "d2"})):
        with pytest.raises(InputError, match=r"a\.json"):
            merge([("a.json", [one]), ("b.json", [other])])


def test_rows_that_say_nothing_of_photos_or_configuration_fit_any(make_row: MakeRow) -> None:
    one, two = make_row("rover", "nobg", "3dgs"), make_row("rover", "nobg", "ours")
    silent = changed(changed(two, "provenance.inputs", {}), "provenance.config_digest", None)
    assert merge([("a", [one]), ("b", [silent])]) == [one, silent]
    assert merge([("a", [silent]), ("b", [one])]) == [silent, one]
    for first, second in ((two, silent), (silent, two)):  # of one experiment: the first counts
        assert merge([("a", [first]), ("b", [second])]) == [first]


def test_older_photos_and_protocols_are_left_out_by_name(make_row: MakeRow) -> None:
    new, other = make_row("rover", "nobg", "3dgs"), make_row("hexapod", "nobg", "3dgs")
    moved = changed(make_row("rover", "nobg", "ours"), "provenance.inputs", {"capture": "d2"})
    old = make_row("rover", "nobg", "ours+") | {"protocol": 1}
    kept, notes = newest_alike(
        [new | {"protocol": 2}, moved | {"protocol": 2}, old, other | {"protocol": 2}]
    )
    assert [(row["capture"], row["method"]) for row in kept] == [
        ("rover", "3dgs"),
        ("hexapod", "3dgs"),
    ]
    assert len(notes) == 2
    assert "other photos than the newest runs: rover/nobg-ours@" in notes[0]
    assert "another protocol (1) than the newest runs: rover/nobg-ours+@" in notes[1]


def test_the_newest_row_alone_sets_the_protocol(make_row: MakeRow) -> None:
    new = make_row("rover", "nobg", "3dgs") | {"protocol": 2}
    old = [make_row("rover", "nobg", method) | {"protocol": 1} for method in ("ours", "ours+")]
    kept, notes = newest_alike([new, *old])
    assert (kept, len(notes)) == ([new], 1)
    assert newest_alike([]) == ([], [])


def test_a_file_of_something_else_is_named(make_row: MakeRow) -> None:
    with pytest.raises(InputError, match=r"b\.json: row 0: .*`capture` is missing"):
        merge([("a.json", [make_row("rover", "nobg", "ours")]), ("b.json", [{"psnr": 3}])])


def test_new_rows_say_their_protocol() -> None:
    assert made.PROTOCOL == PROTOCOL


def test_one_origin_needs_no_words(make_grid: Callable[..., list[Row]]) -> None:
    rows = make_grid()
    assert origins.notes(rows) == []
    assert origins.origins_table(rows) is None
    runs = origins.runs_table(rows)
    assert runs is not None
    assert "Origin" not in runs.headings


def test_seeds_that_start_from_other_masks_are_no_alarm(
    make_grid: Callable[..., list[Row]],
) -> None:
    rows = [
        changed(row, "registration.points", 100 + row["seed"])
        for row in make_grid(captures=("rover",), seeds=2)
    ]
    (note,) = origins.notes(rows)
    assert note == (
        "Rover: seeds started from 2 different sets of masks, poses or sparse points, all "
        "conditions of a seed from the same."
    )


def test_other_code_machines_and_poses_are_told(make_grid: Callable[..., list[Row]]) -> None:
    versions = {"torch": "2.0", "numpy": "2.4"}
    rows = [
        changed(row, "provenance.versions", versions)
        for row in make_grid(captures=("rover", "hexapod"))
    ]
    newer = changed(rows[0], "provenance.code_version", "0.2.0")
    faster = changed(rows[1], "provenance.cpu", "Another CPU")
    library = changed(rows[2], "provenance.versions", versions | {"torch": "3.0"})
    posed = changed(rows[3], "registration.points", 99)
    mine = [newer, faster, library, posed, *rows[4:]]
    text = "\n".join(origins.notes(mine))
    assert "2 states of the code and 2 kinds of machine" in text
    assert "Time, FPS and cost per stage were measured on different machines" in text
    assert "Rover: experiments of one seed started from 2 different sets of masks, poses" in text
    assert "Hexapod" not in text
    table = origins.origins_table(mine)
    assert table is not None
    lines = [line for group in table.groups for line in group.lines]
    assert [line.label for line in lines] == ["Rover", "Rover", "Rover", "Rover, Hexapod"]
    assert [line.entries[0].text for line in lines] == ["1", "1", "1", "5"]
    assert [line.entries[-1].text for line in lines] == [
        "torch 2.0", "torch 2.0", "torch 3.0", "torch 2.0",
    ]  # fmt: skip
    runs = origins.runs_table(mine)
    assert runs is not None
    assert runs.headings[-1] == "Origin"
    assert [line.entries[-1].text for line in runs.groups[0].lines] == ["1", "2", "3", "4"]


def test_a_failed_experiment_has_no_origin(make_row: MakeRow, make_failed: MakeRow) -> None:
    failed = changed(
        make_failed("rover", "nobg", "ours", "killed"), "provenance.code_version", "other"
    )
    assert origins.notes([make_row("rover", "nobg", "3dgs"), failed]) == []


def test_times_of_several_machines_have_no_best(make_grid: Callable[..., list[Row]]) -> None:
    def bold(rows: list[Row]) -> set[str]:
        table = tables.capture_tables(rows)[0]
        return {
            key
            for group in table.groups
            for line in group.lines
            for key, entry in zip(table.keys, line.entries, strict=True)
            if entry.best
        }

    rows = make_grid(captures=("rover",))
    rows = [changed(row, "metrics.time", 50.0 + place) for place, row in enumerate(rows)]
    rows = [changed(row, "metrics.fps", 90.0 - place) for place, row in enumerate(rows)]
    assert {"time", "fps", "size_mb"} <= bold(rows)
    mixed = [changed(row, "provenance.cpu", row["method"]) for row in rows]
    assert bold(mixed) == bold(rows) - {"time", "fps"}


def test_tables_print_the_times_of_the_machine_that_measured_every_line(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    rows = []
    for row in make_grid(captures=("rover",), seeds=3):
        machine, seconds = ("A", 1000.0) if row["seed"] == 0 else ("B", 10.0 + row["seed"])
        rows.append(changed(changed(row, "provenance.cpu", machine), "metrics.time", seconds))
    table = tables.capture_tables(rows)[0]
    place = table.keys.index("time")
    shown = [line.entries[place].value for group in table.groups for line in group.lines]
    assert shown == [11.5] * len(shown)
    assert sum("seeds 1, 2, from one machine, B" in note for note in table.notes) == 1
    (figure,) = trade_off.trade_offs(rows, tmp_path)
    assert "seeds 1, 2, from one machine, B" in figure.caption
    psnr = table.keys.index("psnr")  # whose spread is over all three seeds
    assert all(line.entries[psnr].spread for group in table.groups for line in group.lines)


def test_a_note_names_the_lines_whose_times_are_of_other_seeds(
    make_grid: Callable[..., list[Row]],
) -> None:
    def noted(times_of: dict[str, list[int]]) -> str:
        rows = [
            changed(row, "provenance.cpu", "AB"[row["seed"] in times_of[row["condition"]]])
            for row in make_grid(captures=("rover", "hexapod"), seeds=3)
        ]
        members = [cell for cell in cells(rows) if cell.key.background == "nobg"]
        machine = next(m for m in map(origins.machine_of, rows) if "B" in m)
        return notes.where_timed(members, machine)

    some = {"original-3dgs": [0], "original-ours": [0], "nobg-3dgs": [1, 2]}
    more = noted(some | {"nobg-ours": [0, 1, 2]})
    assert "those of seeds 1, 2 (No BG · Ours: 0, 1, 2), from one machine" in more
    none = noted(some | {"nobg-ours": [0]})
    assert "those of seeds No BG · 3DGS: 1, 2; No BG · Ours: 0, from one machine" in none


def test_times_compare_only_on_one_machine(make_row: MakeRow) -> None:
    def cell(method: str, *machines: str, time: float) -> Cell:
        rows = [
            changed(make_row("rover", "nobg", method, seed), "provenance.cpu", machine)
            for seed, machine in enumerate(machines)
        ]
        times = [time, 10 * time]  # the second seed's machine, or day, was another
        mine = [changed(row, "metrics.time", t) for row, t in zip(rows, times, strict=False)]
        return cells(mine)[0]

    base = cell("3dgs", "A", "B", time=100)
    assert pairs.ratio(cell("ours", "A", "B", time=50), base, "time") == 0.5
    assert pairs.ratio(cell("ours", "A", "C", time=20), base, "time") == 0.2, "of seed 0 alone"
    elsewhere = cell("ours", "C", "C", time=50)
    assert pairs.ratio(elsewhere, base, "time") is None
    assert pairs.ratio(elsewhere, base, "size_mb") == pytest.approx(0.8)
    (found,) = verdict.verdicts([*elsewhere.rows, *base.rows])
    assert "training time" not in found.headline
    assert "time ×" not in "".join(found.details)


@pytest.mark.parametrize(("threads", "kinds"), [("1", 1), ("2", 2), ("8", 2)])
def test_cores_that_no_thread_uses_make_no_other_machine(
    make_row: MakeRow, threads: str, kinds: int
) -> None:
    row = changed(make_row("rover", "nobg", "3dgs"), "provenance.threads", threads)
    machines = {origins.machine_of(changed(row, "provenance.cores", cores)) for cores in ("1", "4")}
    assert len(machines) == kinds
