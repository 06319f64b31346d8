"""Promoted baselines: marked where they stand, and what is measured against them."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

from reports.page.build import build
from reports.tables.promoted import mark, promoted_table

Row = dict[str, Any]
Make = Callable[..., Row]


def test_a_baseline_in_the_report_is_marked_and_nothing_else(
    make_row: Make, tmp_path: Path
) -> None:
    rows = [make_row("rover", "nobg", "3dgs"), make_row("rover", "nobg", "ours")]
    path = build(rows, tmp_path, title="T", artifacts_root=None, baselines=[rows[1]])
    table = (tmp_path / "tables" / "table-1-rover.md").read_text("utf-8")
    assert "| Ours ★ |" in table
    assert "3DGS ★" not in table
    assert "★ promoted" in table
    assert "Against the promoted baseline" in path.read_text("utf-8")
    plain = build(mark(rows, []), tmp_path / "plain", title="T", artifacts_root=None)
    assert "★" not in plain.read_text("utf-8")


def test_differences_are_paired_by_view(make_row: Make) -> None:
    row = make_row("rover", "nobg", "ours")
    old = deepcopy(row) | {"run_id": "old" * 10}
    for place, view in enumerate(old["per_view"]):
        view["mask_psnr"] -= 0.4 + 0.1 * (-1) ** place
    old["metrics"] |= {"size_mb": row["metrics"]["size_mb"] * 2}
    table = promoted_table(mark([row], [old]), [old])
    assert table is not None
    (line,) = table.groups[0].lines
    entries = dict(zip(table.keys, line.entries, strict=True))
    assert entries["mask_psnr_difference"].text == "+0.40"
    assert entries["mask_psnr_difference"].spread == "0.11"
    assert entries["size_mb_ratio"].text == "0.50"
    assert entries["baseline"].text == "oldoldol"


def test_other_settings_have_no_baseline(make_row: Make) -> None:
    row = make_row("rover", "nobg", "ours")
    assert promoted_table([row], [make_row("rover", "nobg", "ours", iterations=7)]) is None
    assert promoted_table([row], []) is None
