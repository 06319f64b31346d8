"""The figure and the table of equal budgets, and that they come first."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from reports.figures.budgets import budget_curves
from reports.figures.plots import style
from reports.page.build import build
from reports.tables.side_tables import BUDGETS, all_tables
from tests.reports.rows.test_budgets import grid

Row = dict[str, Any]


def test_a_report_of_budgets_begins_with_their_figure_and_table(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    rows = grid(make_row)
    path = build(rows, tmp_path, title="Toy", artifacts_root=None)
    page, words = path.read_text(encoding="utf-8"), (tmp_path / "report.md").read_text()
    for text, end in ((page, "Verdict</h2>"), (words, "## Verdict")):
        assert text.index("What a budget buys") < text.index(end)
        assert text.count("At equal size and time, against 3DGS") == 1
    assert 'id="figure-budgets"' in page
    assert "figure-trade-off" not in page, "curves replace the single points"
    assert not list(tmp_path.rglob("figure-trade-off*")), "nor are those drawn"
    assert "3DGS ≤ 5,000" in page
    assert "largest budget" in page
    assert "not valid" not in page


def test_without_budgets_nothing_is_added(make_row: Callable[..., Row], tmp_path: Path) -> None:
    rows = [row for row in grid(make_row) if row.get("budget") in (None, 5000)]
    for row in rows:
        row.pop("budget", None)
    assert budget_curves(rows, tmp_path) == []
    assert BUDGETS not in [table.slug for table in all_tables(rows)]
    page = build(rows, tmp_path, title="Toy", artifacts_root=None).read_text(encoding="utf-8")
    assert "What a budget buys" not in page
    assert "figure-trade-off" in page


def test_the_table_has_means_with_intervals_and_captures(make_row: Callable[..., Row]) -> None:
    table = all_tables(grid(make_row))[0]
    assert table.slug == BUDGETS
    assert [group.label for group in table.groups] == [
        "No BG, mean over captures",
        "Rover, No BG",
        "Hexapod, No BG",
    ]
    mean = table.groups[0].lines[0]
    assert mean.label == "Ours+"
    assert mean.entries[1].text == "+0.50 dB (+0.50 to +0.50)"
    assert mean.entries[1].best
    assert table.groups[1].lines[0].entries[1].text == "+0.50 dB"
    assert [line.label for line in table.groups[0].lines] == ["Ours+", "peer"]


def test_times_of_several_machines_are_no_curve(
    make_row: Callable[..., Row], tmp_path: Path
) -> None:
    rows = grid(make_row)
    with style():
        (one,) = budget_curves(rows, tmp_path / "one")
        rows[0]["provenance"]["cpu"] = "Another CPU"
        (two,) = budget_curves(rows, tmp_path / "two")
    assert "over file size and training time, on" in one.caption
    assert "over file size, on" in two.caption
    assert "Times are left out: they are of different machines." in two.caption
    heights = [len(plt.imread(saved.png)) for saved in (one, two)]
    assert heights[1] < 0.7 * heights[0], "a row less"


def test_the_figure_draws_every_method(make_row: Callable[..., Row], tmp_path: Path) -> None:
    with style():
        (saved,) = budget_curves(grid(make_row), tmp_path)
    assert saved.caption.startswith(
        "At equal size against 3DGS: without background Ours+ +0.50 dB, peer −1.00 dB. PSNR, obj"
    )
    pixels = np.asarray(Image.open(saved.png).convert("RGB")).reshape(-1, 3)
    for colour in ((0x00, 0x72, 0xB2), (0x00, 0x9E, 0x73), (0xCC, 0x79, 0xA7)):
        assert (pixels == colour).all(axis=1).sum() > 50
