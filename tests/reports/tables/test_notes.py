"""What tables say beside their numbers: capped lines, whose masks scored, hazy views."""

from reports.tables import tables
from reports.tables.notes import haze_notes
from tests.reports.conftest import cell_row


def test_a_line_whose_splats_were_capped_says_so() -> None:
    rows = [cell_row("rover", "nobg", "3dgs"), cell_row("rover", "nobg", "ours", capped=3)]
    (table,) = tables.capture_tables(rows)
    assert [line.marks for line in table.groups[0].lines] == ["", " ‡"]
    assert sum("‡ the cap of splats" in note for note in table.notes) == 1
    (table,) = tables.capture_tables(rows[:1])
    assert not any("‡" in note for note in table.notes)


def test_core_and_rim_have_a_table_and_notes_say_whose_masks_scored() -> None:
    assert tables.parts_table([cell_row("rover", "nobg", "3dgs")]) is None
    row = cell_row("rover", "nobg", "3dgs", protocol=2)
    row["metrics"] |= {"core_psnr": 25.0, "rim_psnr": 21.0}
    row["masks"] = row["masks"] | {"scored": "exact"}
    parts = tables.parts_table([row])
    assert parts is not None
    assert parts.headings == ("PSNR in core↑", "PSNR on rim↑")
    masked = tables.mask_table([row])
    assert masked is not None
    assert "Rover: scored by the exact masks that came with the capture." in masked.notes
    assert "Protocol 2." in tables.capture_tables([row])[0].notes[0]
    assert "Protocol 1." in tables.capture_tables([cell_row("rover", "nobg", "3dgs")])[0].notes[0]


def test_hazy_views_are_named_by_their_measure_alone() -> None:
    row = cell_row("rover", "original", "3dgs")
    assert haze_notes([row]) == []
    covers = [{"mask_haze": 0.02, "haze": 0.5}, {"mask_haze": 0.31}, {"haze": 0.2}]
    views = [view | cover for view, cover in zip(row["per_view"], covers, strict=False)]
    (note,) = haze_notes([row | {"per_view": views}])
    assert "Rover, 3DGS on original, seed 0: 0008.jpg (0.31)" in note
    assert "0016.jpg (0.20)" in note  # no mask is known there
    assert "0000.jpg" not in note


def test_the_haziest_views_come_first_whatever_the_order_of_the_rows() -> None:
    rows = []
    for capture, covers in (("rover", [0.11 + 0.01 * n for n in range(6)]), ("fox", [0.9] * 6),
                            ("hexapod", [0.3] * 6)):  # fmt: skip
        row = cell_row(capture, "original", "3dgs")
        for view, cover in zip(row["per_view"], covers, strict=True):
            view["mask_haze"] = cover
        rows.append(row)
    (note,) = haze_notes(rows)
    assert note.index("fox") < note.index("Hexapod")
    assert "Rover" not in note
    assert note.endswith("and 6 more.")
    assert haze_notes(rows[::-1]) == [note]


def test_a_table_without_lpips_says_why() -> None:
    row = cell_row("rover", "nobg", "3dgs")
    assert tables.perceptual_table([row]) is None
    row["metrics"]["flip"] = 0.1
    table = tables.perceptual_table([row])
    assert table is not None
    assert table.headings == ("FLIP↓",)
    assert any("LPIPS is absent" in note for note in table.notes)
    row["metrics"]["lpips"] = 0.2
    table = tables.perceptual_table([row])
    assert table is not None
    assert table.headings == ("FLIP↓", "LPIPS↓")
    assert not any("absent" in note for note in table.notes)
