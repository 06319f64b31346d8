"""Tables I–III: what is bold, what is a hole, what fits a terminal."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from mattgs_ops.score.metric_table import METRICS
from reports.rows import columns
from reports.tables import formats, paper, side_tables, tables

Row = dict[str, Any]


def line_of(table: formats.Table, group: str, label: str) -> formats.Line:
    (found,) = [
        line for g in table.groups if g.label == group for line in g.lines if line.label == label
    ]
    return found


def test_there_is_one_table_per_capture_as_the_paper_numbers_them(
    make_grid: Callable[..., list[Row]],
) -> None:
    found = tables.capture_tables(make_grid(captures=("fox", "lattepanda", "hexapod", "rover")))
    assert [t.heading.split(":")[0] for t in found] == [
        "Table I. Rover",
        "Table II. Hexapod",
        "Table III. LattePanda",
        "Table IV. fox",
    ]
    assert [g.label for g in found[0].groups] == ["Original", "No BG"]
    assert [line.label for line in found[0].groups[0].lines] == ["3DGS", "Ours"]
    assert found[0].headings == (
        "SSIM↑",
        "PSNR↑",
        "L1↓",
        "Loss↓",
        "FPS↑",
        "Time↓",
        "Size(MB)↓",
    )


def test_settings_are_not_mixed_in_one_table(make_row: Callable[..., Row]) -> None:
    short = make_row("rover", "nobg", "3dgs")
    long = make_row("rover", "nobg", "3dgs", iterations=30_000)
    found = tables.capture_tables([long, short])
    assert [t.title for t in found] == [
        "Rover: 1,000 iterations, longest side 320 px",
        "Rover: 30,000 iterations, longest side 320 px",
    ]


def test_the_best_is_judged_by_direction_within_the_group(make_row: Callable[..., Row]) -> None:
    plain, ours = make_row("rover", "nobg", "3dgs"), make_row("rover", "nobg", "ours")
    plain["metrics"] |= {"psnr": 25.0, "l1": 0.05, "fps": 60.0, "size_mb": 4.0, "ssim": 0.9}
    ours["metrics"] |= {"psnr": 24.0, "l1": 0.04, "fps": 50.0, "size_mb": 3.0, "ssim": 0.9}
    (table,) = tables.capture_tables([plain, ours])
    best = {
        line.label: {k for k, e in zip(table.keys, line.entries, strict=True) if e.best}
        for line in table.groups[0].lines
    }
    assert best == {"3DGS": {"psnr", "fps"}, "Ours": {"l1", "size_mb"}}  # a tie has no best


def test_what_looks_equal_is_equal(make_row: Callable[..., Row]) -> None:
    rows = [make_row("rover", "nobg", m) for m in ("3dgs", "ours", "other")]
    for row, psnr in zip(rows, (25.004, 25.001, 24.0), strict=True):
        row["metrics"]["psnr"] = psnr
    (table,) = tables.capture_tables(rows)
    assert [line.entries[1].best for line in table.groups[0].lines] == [True, True, False]


def test_a_group_of_one_has_no_best(make_row: Callable[..., Row]) -> None:
    (table,) = tables.capture_tables([make_row("rover", "nobg", "3dgs")])
    assert not any(entry.best for entry in table.groups[0].lines[0].entries)


def test_seeds_give_mean_and_spread_at_full_precision_in_csv(
    make_row: Callable[..., Row],
) -> None:
    rows = [make_row("rover", "nobg", "3dgs", seed) for seed in range(3)]
    values = [25.1, 25.2, 25.6]
    for row, value in zip(rows, values, strict=True):
        row["metrics"]["psnr"] = value
    (table,) = tables.capture_tables(rows)
    assert line_of(table, "No BG", "3DGS").entries[1].full == "25.30 ± 0.26"
    (record,) = csv.DictReader(io.StringIO(formats.csv(table)))
    assert float(record["psnr"]) == pytest.approx(fmean(values), rel=1e-15)
    assert float(record["psnr_deviation"]) == pytest.approx(stdev(values), rel=1e-12)
    assert record["runs"].split() == [row["run_id"] for row in rows]


def test_a_failed_cell_is_a_hole_with_its_reason(
    make_row: Callable[..., Row], make_failed: Callable[..., Row]
) -> None:
    rows = [
        make_row("rover", "nobg", "3dgs"),
        make_failed("rover", "nobg", "ours", "ran out of memory"),
    ]
    (table,) = tables.capture_tables(rows)
    line = line_of(table, "No BG", "Ours")
    assert all(entry.text == "–" for entry in line.entries)
    assert any("ran out of memory" in note and line.marks.strip() in note for note in table.notes)
    assert "ran out of memory" in tables.terminal(rows)


def test_one_failed_seed_of_two_is_said_and_the_other_still_counts(
    make_row: Callable[..., Row], make_failed: Callable[..., Row]
) -> None:
    rows = [
        make_row("rover", "nobg", "3dgs", 0),
        make_failed("rover", "nobg", "3dgs", "killed", seed=1),
    ]
    (table,) = tables.capture_tables(rows)
    assert line_of(table, "No BG", "3DGS").entries[0].text != "–"
    assert "seed 1 failed: killed; the line is the mean of the other 1" in table.notes[0]


@pytest.mark.parametrize("seeds", [1, 3])
def test_a_terminal_of_80_columns_holds_the_tables(
    make_grid: Callable[..., list[Row]], seeds: int
) -> None:
    rows = make_grid(methods=("3dgs", "ours", "ours+"), seeds=seeds)
    for row in rows:
        row["metrics"] |= {"time": 3725.4 + 100 * row["seed"], "size_mb": 123.45}
    text = tables.terminal(rows)
    assert max(map(len, text.splitlines())) <= formats.TERMINAL_WIDTH == 80
    assert "1h 02m 05s" in text or "1h 03m 45s" in text
    assert text.count("Table ") == 3


def test_notes_state_the_protocol(make_grid: Callable[..., list[Row]]) -> None:
    notes = " ".join(tables.capture_tables(make_grid())[0].notes)
    assert "6 held-out test views" in notes
    assert "Protocol 1" in notes
    assert "do not compare with Original" in notes


def test_the_papers_values_stand_in_tables_of_the_papers_length_alone(
    make_grid: Callable[..., list[Row]],
) -> None:
    rows = make_grid(captures=("rover",))
    (short,) = tables.capture_tables(rows)
    assert "(paper)" not in formats.plain(short)
    assert "The paper's values are of 30,000 iterations" in short.notes[-1]
    (table,) = tables.capture_tables([row | {"iterations": 30_000} for row in rows])
    # read off Table I by hand, not from the file
    assert line_of(table, "Original", "3DGS (paper)").entries[1].value == 25.616
    assert line_of(table, "No BG", "Ours (paper)").entries[4].value == 56.980
    assert any("cannot be on the scale of its own PSNR" in note for note in table.notes)


def test_values_of_another_file_take_the_place_of_those_that_come_along(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    rows = make_grid(captures=("rover",))
    path = tmp_path / "values.toml"
    value = '[[value]]\ncapture="rover"\nbackground="nobg"\nmethod="ours"\npsnr=99.0\n'
    path.write_text(value + '[source]\nread_from="v1, page 5"\n[[difference]]\ntext="Others."\n')
    (table,) = tables.capture_tables(rows, paper.load(path))
    line = line_of(table, "No BG", "Ours (paper)")
    assert line.entries[1].text == "99.00"
    assert not line.entries[1].best
    assert "Lines marked (paper): Others." in table.notes
    ours = line_of(table, "No BG", "Ours").entries[1].value
    difference = line_of(table, "No BG", "Ours − paper").entries
    assert ours is not None
    assert difference[1].value == pytest.approx(ours - 99.0)
    assert difference[1].text.startswith("−")
    assert difference[0] == tables.HOLE, "the file says nothing of SSIM"
    assert any("v1, page 5" in note for note in table.notes)
    assert "*Ours − paper*" in formats.markdown(table)


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("psnr='much'", "`psnr`: expected a finite number"),
        ("psnr=nan", "`psnr`: expected a finite number"),
        ("PSNR=20.0", r"found unknown \['PSNR'\]"),
    ],
)
def test_a_value_that_is_none_is_refused_by_name(line: str, wrong: str, tmp_path: Path) -> None:
    path = tmp_path / "values.toml"
    cell = 'capture="rover"\nbackground="nobg"\nmethod="ours"\n'
    path.write_text(f"[source]\nread_from='p'\n[[value]]\n{cell}{line}\n")
    with pytest.raises(InputError, match=f"rover nobg ours.*{wrong}"):
        paper.load(path)


def test_any_method_and_the_small_parts_have_their_places(make_grid: Callable[..., Any]) -> None:
    rows = make_grid(captures=("rover",), methods=("3dgs", "mine", "ours", "ours+"))
    for row in rows:
        row["metrics"] |= {"detail_psnr": 20.0, "detail_ssim": 0.7}
    (table,) = tables.capture_tables(rows)
    assert [line.label for line in table.groups[0].lines] == ["3DGS", "Ours", "Ours+", "mine"]
    inside = tables.mask_table(rows)
    assert inside is not None
    assert {"detail_psnr", "detail_ssim"} <= set(inside.keys)


def test_values_without_a_source_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "values.toml"
    path.write_text('[[value]]\ncapture="rover"\nbackground="nobg"\nmethod="ours"\npsnr=9.0\n')
    with pytest.raises(InputError, match="read_from"):
        paper.load(path)


def test_the_length_of_training_is_a_number_of_steps(tmp_path: Path) -> None:
    path = tmp_path / "values.toml"
    path.write_text('[source]\nread_from="p"\niterations="many"\n')
    with pytest.raises(InputError, match=r"source.iterations.*found 'many'"):
        paper.load(path)


def test_all_twelve_lines_of_the_paper_are_shipped_with_their_source() -> None:
    loaded = paper.load()
    assert len(loaded.values) == 12
    assert loaded.source["read_from"]
    assert loaded.source["iterations"] == 30_000


def test_side_tables_cover_masks_inputs_cost_and_runs(make_grid: Callable[..., list[Row]]) -> None:
    found = {table.slug: table for table in side_tables.all_tables(make_grid())}
    scores = ["table-in-mask", "table-differences", "table-training"]
    assert list(found)[-6:] == [*scores, "table-inputs", "table-cost", "table-runs"]
    assert "48 of 48" in formats.markdown(found["table-inputs"])
    assert found["table-cost"].headings == ("Prepare", "Segment", "SfM", "Train", "Evaluate")
    assert "c0ffee" in formats.markdown(found["table-runs"])


def test_the_inputs_table_tells_of_fallbacks_and_lost_views(
    make_grid: Callable[..., list[Row]],
) -> None:
    rows = make_grid()
    for row in rows:
        row["registration"] |= {
            "keypoints": {"original": 4000, "masked": 900},
            "matches": {"whole": 700, "masked guided": 50},
            "fallbacks": ["too few key points inside masks: lower peak threshold"],
            "lost": [{"name": "0007.jpg", "keypoints": 31, "masked": 4}],
            "agreement": {"none": "masks are given, nothing to vote on"},
        }
    (table,) = (t for t in side_tables.all_tables(rows) if t.slug == "table-inputs")
    text = formats.markdown(table)
    for number in ("4,000", "900", "750"):
        assert f" {number} |" in text
    first = rows[0]["capture"]
    told = [note for note in table.notes if note.lower().startswith(first)]
    assert [note.partition(": ")[2] for note in told] == [
        "too few key points inside masks: lower peak threshold.",
        "0007.jpg was not registered; it has 31 key points, 4 of them in its mask.",
        "masks were not voted on: masks are given, nothing to vote on.",
    ], "once per capture, not once per row"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(4.23, "4.2 s"), (9.97, "10 s"), (42.4, "42 s"), (59.6, "1m 00s"), (790, "13m 10s")],
)
def test_durations_read_as_the_paper_prints_them(seconds: float, text: str) -> None:
    assert columns.duration(seconds) == text


def test_columns_agree_with_the_table_of_metrics() -> None:
    for column in (*columns.PAPER, *columns.IN_MASK, *columns.CORE_AND_RIM, *columns.PERCEPTUAL):
        metric = METRICS[column.key]
        assert (column.label, column.direction) == (metric.label, metric.direction)
        if column.kind != "time":
            assert columns.DECIMALS[column.kind] == metric.decimals, column.key
    for column in columns.TRAINING:
        assert METRICS[column.key].label == f"Training {column.label}"


def test_roman_numerals_go_on_after_the_papers_three() -> None:
    assert [columns.roman(n) for n in (1, 2, 3, 4, 9, 14)] == ["I", "II", "III", "IV", "IX", "XIV"]


def test_other_programs_are_named_with_what_their_times_are_of(
    make_row: Callable[..., Row],
) -> None:
    theirs = make_row("rover", "nobg", "opensplat")
    theirs["provenance"] |= {"trainer": {"identity": {"version": "1.1.4", "files": {}}}}
    for row in (theirs, make_row("rover", "nobg", "3dgs")):
        row["provenance"] = row["provenance"] or {}
    (table,) = tables.capture_tables([theirs, make_row("rover", "nobg", "3dgs")])
    (note,) = [text for text in table.notes if "Other programs" in text]
    assert note.startswith("Other programs: opensplat (1.1.4). Their times are of the whole proc")
    (table,) = tables.capture_tables([make_row("rover", "nobg", "3dgs")])
    assert not any("Other programs" in text for text in table.notes)
