"""Every method against a base: paired differences, ratios, and the mean over all pairs."""

import csv
import io

import pytest

from reports.rows.schema import Row
from reports.tables import formats
from reports.tables.differences import difference_tables
from reports.tables.verdict import overall, verdicts
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


def test_times_are_compared_over_the_seeds_that_both_sides_have() -> None:
    base = [shifted(cell_row("rover", "nobg", "3dgs", seed), 0, time=10.0) for seed in (0, 1)]
    base[1]["metrics"]["time"] = 30.0  # other work ran beside this one
    ours = shifted(cell_row("rover", "nobg", "ours+", 0), 0.7, time=5.0)
    (table,) = difference_tables([*base, ours])
    time = table.keys.index("time")
    assert table.groups[0].lines[0].entries[time].text == "0.50"


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


def second(row: Row, gain: float = 0.0, outlier: float = 0.0) -> Row:
    """Turn a row into one of protocol 2, with core and rim; one view may stand out."""
    base = cell_row(row["capture"], row["background"], "3dgs", row["seed"])
    views = []
    for index, view in enumerate(base["per_view"]):
        own = view["mask_psnr"] + gain + 0.01 * (-1) ** index * (gain != 0)
        own += outlier * (index == 2)
        parts = {"core_psnr": own + 2, "rim_psnr": own - 2, "core_ssim": view["mask_ssim"]}
        views.append(view | {"mask_psnr": own} | parts)
    metrics = row["metrics"] | {"core_psnr": 25.0, "rim_psnr": 21.0, "core_ssim": 0.8}
    return row | {"protocol": 2, "per_view": views, "metrics": metrics}


def second_grid(methods: tuple[str, ...], outlier: float = 0.0) -> list[Row]:
    gains = {"3dgs": 0.0, "3dgs-tuned": 0.4, "ours": -0.5, "ours+": 0.7}
    return [
        second(
            cell_row(capture, background, method),
            gains[method] + lift,
            outlier * (gains[method] > 0.5),
        )
        for capture, lift in (("rover", 0.0), ("hexapod", 0.0), ("lattepanda", 0.0))
        for background in ("original", "nobg")
        for method in methods
    ]


def test_captures_are_the_samples_of_the_mean_over_them() -> None:
    rows = second_grid(("3dgs", "ours+"))
    for index, row in enumerate(rows):
        if row["capture"] == "rover" and row["method"] == "ours+":
            rows[index] = second(row, 1.9)
    (table,) = difference_tables(rows)
    assert [group.label for group in table.groups[-3:]] == [
        "Mean over captures, Original",
        "Mean over captures, No BG",
        "Mean over captures, both",
    ]
    both = table.groups[-1].lines[0].entries[table.keys.index("mask_psnr")]
    assert both.value == pytest.approx(1.1)
    # Student's interval of 1.9, 0.7 and 0.7: three samples, though there are six pairs
    assert float(both.spread) == pytest.approx(4.303 * 1.2 / 3, abs=0.005)
    assert not both.best
    assert "mask_ssim" not in table.keys
    assert {"core_psnr", "rim_psnr", "core_ssim"} <= set(table.keys)


def test_a_median_stands_beside_the_mean_where_a_view_is_an_outlier() -> None:
    (table,) = difference_tables(second_grid(("3dgs", "ours+"), outlier=6.0))
    entry = table.groups[0].lines[0].entries[table.keys.index("mask_psnr")]
    assert entry.value == pytest.approx(1.7, abs=0.01)
    assert entry.full.endswith("(median +0.70)")
    (record, *_) = csv.DictReader(io.StringIO(formats.csv(table)))
    numbers = {part: float(record[f"mask_psnr_{part}"]) for part in ("low", "high", "median")}
    assert numbers["low"] < 0 < numbers["high"]
    assert numbers["low"] + numbers["high"] == pytest.approx(2 * float(record["mask_psnr"]))
    assert numbers["median"] == pytest.approx(0.70, abs=0.011)
    assert "size_mb_low" not in record, "ratios have no interval"
    (table,) = difference_tables(second_grid(("3dgs", "ours+")))
    assert "median" not in table.groups[0].lines[0].entries[0].full


def test_the_tuned_control_is_a_base_of_its_own() -> None:
    plain, control = difference_tables(second_grid(("3dgs", "3dgs-tuned", "ours", "ours+")))
    assert [line.label for line in plain.groups[0].lines] == ["3DGS tuned", "Ours", "Ours+"]
    assert control.title == "Against 3DGS tuned"
    assert [line.label for line in control.groups[0].lines] == ["Ours", "Ours+"]
    entry = control.groups[0].lines[1].entries[control.keys.index("mask_psnr")]
    assert entry.value == pytest.approx(0.3)


def test_every_claim_is_made_against_both_bases() -> None:
    rows = second_grid(("3dgs", "3dgs-tuned", "ours", "ours+"))
    found = overall(rows)
    assert found is not None
    assert not found.headline.startswith("Without backgrounds, 3DGS tuned"), "a mere control"
    sentences = [found.headline, *found.details]
    for background in ("Without backgrounds", "With backgrounds"):
        for base, gain in (("3DGS", "+0.70"), ("3DGS tuned", "+0.30")):
            start = f"{background}, Ours+ gains over {base} on all 3 captures; on average {gain}"
            (sentence,) = [text for text in sentences if text.startswith(start)]
            assert "± 0.00 dB inside the mask" in sentence
    rover = verdicts(rows)[0]
    assert "Ours+ gains 0.70 dB inside the mask over 3DGS" in rover.headline
    assert "and gains 0.30 dB inside the mask over 3DGS tuned" in rover.headline
    assert any("Ours+ − 3DGS tuned: PSNR in mask +0.30" in text for text in rover.details)
    assert any("in its core" in text and "on its rim" in text for text in rover.details)
