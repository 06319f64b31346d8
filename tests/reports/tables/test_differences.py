"""Every method against a base: paired differences, ratios, and the mean over all pairs."""

import pytest

from reports.rows.schema import Row
from reports.tables.differences import difference_tables
from tests.reports.conftest import cell_row, failed_row

METHODS = ("3dgs", "ours", "ours+")


def shifted(row: Row, decibels: float, by_view: float = 0.0, **metrics: float) -> Row:
    """Give a row the 3DGS row's in-mask scores plus something, and other costs."""
    base = cell_row(row["capture"], row["background"], "3dgs", row["seed"])
    views = [
        view | {"mask_psnr": view["mask_psnr"] + decibels + by_view * (-1) ** index}
        for index, view in enumerate(base["per_view"])
    ]
    return row | {"per_view": views, "metrics": row["metrics"] | metrics}


def grid(methods: tuple[str, ...] = METHODS) -> list[Row]:
    rows = []
    for capture in ("rover", "hexapod"):
        for method in methods:
            row = cell_row(capture, "nobg", method)
            gain = {"3dgs": 0.0, "ours": -0.5, "ours+": 0.7}.get(method, 0.1)
            costs = {"size_mb": 4.0 if method == "3dgs" else 2.0, "time": 10.0, "fps": 50.0}
            rows.append(shifted(row, gain, 0.01 if method != "3dgs" else 0, **costs))
    return rows


def test_differences_are_paired_and_costs_are_ratios() -> None:
    (table,) = difference_tables(grid())
    assert [group.label for group in table.groups] == [
        "Rover, No BG",
        "Hexapod, No BG",
        "Mean over all",
    ]
    ours, best = table.groups[0].lines
    assert (ours.label, best.label) == ("Ours", "Ours+")
    assert [line.entries[0].text for line in (ours, best)] == ["−0.50", "+0.70"]
    assert best.entries[0].best, "what every view shows is certain"
    assert 0 < float(best.entries[0].spread) < 0.03
    size = table.keys.index("size_mb")
    assert best.entries[size].text == "0.50"


def test_the_last_group_weighs_pairs_alike() -> None:
    rows = grid()
    for index, row in enumerate(rows):
        if row["capture"] == "hexapod" and row["method"] == "ours+":
            rows[index] = shifted(row, 1.7, size_mb=1.0)
    (table,) = difference_tables(rows)
    best = table.groups[-1].lines[1]
    assert best.entries[0].value == pytest.approx(1.2)
    assert not best.entries[0].best, "two pairs that differ by a decibel prove nothing"
    size = table.keys.index("size_mb")
    assert best.entries[size].value == pytest.approx(0.5 * 0.5**0.5)


def test_variants_are_compared_with_the_best_method_too() -> None:
    plain, best = difference_tables(grid((*METHODS, "without-weight")))
    assert plain.title == "Against 3DGS"
    assert best.title == "Against Ours+"
    labels = [line.label for line in best.groups[0].lines]
    assert "without-weight" in labels
    assert "Ours+" not in labels
    variant = best.groups[0].lines[labels.index("without-weight")]
    assert variant.entries[0].text == "−0.60"


def test_a_score_that_nobody_has_is_a_hole_and_a_missing_base_no_table() -> None:
    (table,) = difference_tables(grid())
    assert table.groups[0].lines[0].entries[table.keys.index("detail_psnr")].text == "–"
    failed = failed_row("rover", "nobg", "3dgs", "killed")
    assert difference_tables([failed, cell_row("rover", "nobg", "ours")]) == []
