"""What is the best of both backgrounds, and what of each: full frames do not compare."""

import pytest

from reports.rows.schema import Row
from reports.tables import tables
from reports.tables.formats import Table
from tests.reports.conftest import cell_row

SCORES = {  # of 3DGS and Ours with the background, then of 3DGS and Ours without
    "mask_psnr": (21.0, 22.0, 24.0, 23.0),
    "mask_cc_psnr": (21.0, 22.0, 24.0, 23.0),
    "mask_ssim": (0.81, 0.82, 0.84, 0.83),
    "mask_l1": (0.05, 0.04, 0.02, 0.03),
    "core_ssim": (0.81, 0.82, 0.84, 0.83),
    "rim_ssim": (0.81, 0.82, 0.84, 0.83),
    "detail_ssim": (0.81, 0.82, 0.84, 0.83),
    "flip": (0.5, 0.4, 0.2, 0.3),
    "core_flip": (0.5, 0.4, 0.2, 0.3),
    "cc_psnr": (21.0, 22.0, 24.0, 23.0),
    "train_psnr": (21.0, 22.0, 24.0, 23.0),
}
BOTH, EACH = [False, False, True, False], [False, True, True, False]


@pytest.fixture
def rows() -> list[Row]:
    conditions = [(b, m) for b in ("original", "nobg") for m in ("3dgs", "ours")]
    made = [cell_row("rover", background, method) for background, method in conditions]
    for place, row in enumerate(made):
        row["metrics"] |= {key: values[place] for key, values in SCORES.items()}
    return made


def bold(table: Table | None, key: str) -> list[bool]:
    assert table is not None
    (group,) = table.groups
    return [line.entries[table.keys.index(key)].best for line in group.lines]


@pytest.mark.parametrize("key", ["mask_psnr", "mask_cc_psnr", "mask_l1"])
def test_pixels_of_the_object_compare_across_backgrounds(rows: list[Row], key: str) -> None:
    assert bold(tables.mask_table(rows), key) == BOTH


@pytest.mark.parametrize("key", ["mask_ssim", "detail_ssim"])
def test_windows_that_see_the_desk_do_not(rows: list[Row], key: str) -> None:
    table = tables.mask_table(rows)
    assert bold(table, key) == EACH
    assert table is not None
    both = "PSNR in mask, PSNR in mask colour-corrected, L1 in mask"
    note = f"Bold is the best of both backgrounds in {both}, else of each background."
    assert table.notes[-1] == note
    alone = tables.mask_table(rows[2:])
    assert alone is not None
    assert not any("Bold" in text for text in alone.notes)


def test_the_core_is_free_of_what_lies_beside_the_object(rows: list[Row]) -> None:
    table = tables.parts_table(rows)
    assert bold(table, "core_ssim") == BOTH
    assert bold(table, "rim_ssim") == EACH


def test_full_frames_have_a_best_of_each_background(rows: list[Row]) -> None:
    table = tables.perceptual_table(rows)
    for key in ("flip", "core_flip", "cc_psnr"):
        assert bold(table, key) == EACH, key
    assert table is not None
    assert "across backgrounds it does not compare" in table.notes[0]
    assert table.notes[-1] == "Bold is the best of each background."
    inside = tables.mask_table(rows)
    assert inside is not None
    assert "cc_psnr" not in inside.keys, "a score of the full frame is none of the mask"
    assert bold(tables.training_table(rows), "train_psnr") == EACH
