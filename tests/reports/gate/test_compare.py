"""The gate's verdicts: planted changes are named on the right metric, and nothing else is."""

import json
import math
from collections.abc import Callable
from copy import deepcopy

import jsonschema
import pytest

from reports.gate import output, planted, speed
from reports.gate.compare import compare, verdict_of
from reports.gate.findings import ALL_CELLS, Exit, Verdict
from reports.gate.tolerances import Doubt
from reports.rows.schema import Row
from reports.rows.statistics import Interval
from tests.reports.gate.conftest import SCHEMA, Rows, changed, found, jittered, shift_views


def test_the_same_rows_are_the_same_everywhere(old: Rows) -> None:
    report = compare(old, old)
    assert report.exit_code == Exit.PASS
    assert found(report, Verdict.WORSE) == found(report, Verdict.BETTER) == set()
    quality = {f.verdict for f in report.findings if f.aspect in ("quality", "size", "run")}
    assert quality == {Verdict.SAME}


def test_unchanged_code_on_another_machine_passes(old: Rows) -> None:
    report = compare(jittered(old), old)
    assert report.exit_code == Exit.PASS
    assert not found(report, Verdict.WORSE)


def test_a_uniformly_slower_machine_is_not_slower_code(old: Rows) -> None:
    def halve(row: Row) -> None:
        row["metrics"]["time"] *= 2
        row["metrics"]["fps"] /= 2
        row["provenance"]["calibration"] = {"seconds": 1.0}

    assert compare(changed(old, halve), old).exit_code == Exit.PASS


def test_a_small_loss_everywhere_shows_over_all_cells(old: Rows) -> None:
    report = compare(changed(old, lambda row: shift_views(row, psnr=-0.3)), old)
    assert report.exit_code == Exit.REGRESSION
    assert (ALL_CELLS, "psnr") in found(report, Verdict.WORSE)
    assert {metric for _, metric in found(report, Verdict.WORSE)} == {"psnr"}


def test_a_wrong_learning_rate_is_a_loss_of_quality(old: Rows) -> None:
    def spoil(row: Row) -> None:
        shift_views(row, psnr=-2.5, mask_psnr=-2.0, ssim=-0.05, mask_ssim=-0.06, l1=0.01)

    report = compare(changed(old, spoil), old)
    assert {m for _, m in found(report, Verdict.WORSE)} == {
        "psnr",
        "mask_psnr",
        "ssim",
        "mask_ssim",
        "l1",
    }
    assert report.findings[0].verdict == Verdict.WORSE


def test_inverted_attention_is_named_in_the_cells_of_ours_only(old: Rows) -> None:
    rows = changed(
        old, lambda row: shift_views(row, mask_psnr=-1.0), lambda row: row["method"] == "ours"
    )
    worse = {cell for cell, m in found(compare(rows, old), Verdict.WORSE) if m == "mask_psnr"}
    assert {cell for cell in worse if cell != ALL_CELLS} == {
        f"{capture}/{background}-ours@1000x320"
        for capture in ("rover", "hexapod", "lattepanda")
        for background in ("original", "nobg")
    }


def test_a_leaked_test_view_is_not_a_gain(old: Rows) -> None:
    def leak(row: Row) -> None:
        shift_views(row, psnr=+3.0)
        row["per_view"].append(row["per_view"][0] | {"split": "train"})

    report = compare(changed(old, leak), old)
    assert report.exit_code == Exit.CANNOT_JUDGE
    assert not found(report, Verdict.BETTER)
    reasons = {f.reason for f in report.findings if f.verdict == Verdict.NOT_COMPARABLE}
    assert reasons == {"held-out views were trained on: 0000.jpg"}


def test_dilated_masks_are_named_on_their_iou(old: Rows) -> None:
    def dilate(row: Row) -> None:
        row["masks"]["mean_iou"] -= 0.08

    report = compare(changed(old, dilate), old)
    assert {m for _, m in found(report, Verdict.WORSE)} == {"mean_iou"}


def test_lost_registrations_are_worse_however_few(old: Rows) -> None:
    def lose(row: Row) -> None:
        row["registration"]["registered"] -= 1

    report = compare(changed(old, lose, lambda row: row["capture"] == "rover"), old)
    assert {m for _, m in found(report, Verdict.WORSE)} == {"registered"}


def test_a_lost_registration_is_worse_though_its_view_is_missing(old: Rows) -> None:
    """As a run leaves it: a training photo without a camera was not trained on."""
    before = [row | {"trained_on": ["a.jpg", "b.jpg"]} for row in old]
    after = changed(before, lambda row: row.update(trained_on=["a.jpg"]))
    for row in after:
        row["registration"]["registered"] -= 1
    report = compare(after, before)
    assert {metric for _, metric in found(report, Verdict.WORSE)} == {"registered"}
    assert {metric for _, metric in found(report, Verdict.NOT_COMPARABLE)} == {"rows"}
    assert report.exit_code == Exit.REGRESSION


def test_a_dropped_capture_is_newly_failing(old: Rows) -> None:
    report = compare([row for row in jittered(old) if row["capture"] != "hexapod"], old)
    assert report.exit_code == Exit.FAILED_RUNS
    missing = {cell for cell, _ in found(report, Verdict.NEWLY_FAILING)}
    assert len(missing) == 4
    assert all(cell.startswith("hexapod/") for cell in missing)


def test_a_sleep_in_the_rasteriser_is_named_on_speed(old: Rows) -> None:
    report = compare([planted.lose_speed(row) for row in jittered(old)], old)
    worse = found(report, Verdict.WORSE)
    assert {(ALL_CELLS, "time"), (ALL_CELLS, "fps")} <= worse
    assert {metric for _, metric in worse} == {"time", "fps"}


def test_twice_the_splats_are_named_on_size(old: Rows) -> None:
    report = compare([planted.grow(row, 1.0) for row in jittered(old)], old)
    assert {m for _, m in found(report, Verdict.WORSE)} == {"size_mb", "splats"}
    assert len(found(report, Verdict.WORSE)) == 2 * 13


def test_ten_percent_in_one_cell_are_found_there(old: Rows) -> None:
    rows = jittered(old)
    rows[5] = planted.grow(rows[5])
    worse = found(compare(rows, old), Verdict.WORSE)
    assert {metric for _, metric in worse} == {"size_mb", "splats"}
    assert len(worse) == 2


def test_gains_are_better_and_pass(old: Rows) -> None:
    report = compare(changed(old, lambda row: shift_views(row, psnr=0.5)), old)
    assert report.exit_code == Exit.PASS
    assert (ALL_CELLS, "psnr") in found(report, Verdict.BETTER)


def test_failures_are_newly_failing_fixed_or_known(
    old: Rows, make_failed: Callable[..., Row]
) -> None:
    broken = [make_failed("rover", "original", "3dgs", "out of memory"), *old[1:]]
    report = compare(broken, old)
    assert report.exit_code == Exit.FAILED_RUNS
    (finding,) = [f for f in report.findings if f.verdict == Verdict.NEWLY_FAILING]
    assert "out of memory" in finding.reason
    fixed = compare(old, broken)
    assert fixed.exit_code == Exit.PASS
    assert len(found(fixed, Verdict.FIXED)) == 1
    known = compare(broken, broken)
    assert known.exit_code == Exit.PASS, "the baseline expects it"
    (finding,) = [f for f in known.findings if f.verdict == Verdict.STILL_FAILING]
    assert "out of memory" in finding.reason
    nothing = [make_failed("rover", "original", "3dgs", "out of memory")]
    assert compare(nothing, nothing).exit_code == Exit.CANNOT_JUDGE


def test_a_new_cell_asks_for_a_new_baseline(old: Rows) -> None:
    report = compare(old, old[1:])
    assert report.exit_code == Exit.CANNOT_JUDGE
    assert "no such cell" in report.findings[0].reason


def test_nothing_at_all_cannot_be_judged() -> None:
    assert compare([], []).exit_code == Exit.CANNOT_JUDGE


def test_a_regression_outranks_a_failed_run(old: Rows) -> None:
    rows = changed(old, lambda row: shift_views(row, psnr=-3.0))[1:]
    assert compare(rows, old).exit_code == Exit.REGRESSION


def test_a_doubtful_loss_cannot_be_judged_a_doubtful_trifle_can(old: Rows) -> None:
    small = old[:1]
    rows = deepcopy(small)
    shifts = (-2.0, 1.0, -1.5, 0.6, -0.4, 0.3)
    for view, shift in zip(rows[0]["per_view"], shifts, strict=True):
        view["psnr"] += shift
    report = compare(rows, small)
    assert (report.findings[0].metric, report.findings[0].verdict) == ("psnr", "inconclusive")
    assert report.exit_code == Exit.CANNOT_JUDGE
    for view in rows[0]["per_view"]:
        view["psnr"] += 0.35  # the estimate is now within the margin
    assert compare(rows, small).exit_code == Exit.PASS
    assert compare(rows, small, doubt=Doubt.ALL).exit_code == Exit.CANNOT_JUDGE


def test_doubt_can_be_told_only(old: Rows) -> None:
    rows = deepcopy(old[:1])
    for view, shift in zip(rows[0]["per_view"], (-2.0, 1.0, -1.5, 0.6, -0.4, 0.3), strict=True):
        view["psnr"] += shift
    report = compare(rows, old[:1], doubt=Doubt.NONE)
    assert report.findings[0].verdict == Verdict.INCONCLUSIVE
    assert report.exit_code == Exit.PASS


@pytest.mark.parametrize("field", ["cpu", "cores", "threads", "cpu_kind", "workload"])
def test_speed_of_another_machine_is_not_compared_and_excused(old: Rows, field: str) -> None:
    def move(row: Row) -> None:
        row["provenance"][field] = "other"
        row["metrics"]["time"] *= 5

    report = compare(changed(old, move), old)
    assert found(report, Verdict.NOT_COMPARABLE) == {(ALL_CELLS, "time"), (ALL_CELLS, "fps")}
    assert report.exit_code == Exit.PASS
    assert compare(changed(old, move), old, doubt=Doubt.ALL).exit_code == Exit.CANNOT_JUDGE
    assert f"another machine ({field}: baseline" in output.terminal(report)
    jsonschema.validate(json.loads(output.to_json(report)), json.loads(SCHEMA.read_text()))
    assert 'errors="1"' not in output.junit(report)


def test_each_speed_is_of_the_machine_that_it_was_measured_on(old: Rows) -> None:
    """Trained on one machine, rendered on another: only the rendering is not comparable."""

    def measure_elsewhere(row: Row) -> None:
        row["provenance"]["measured"] = {"cpu": "Another CPU", "threads": 1}

    report = compare(changed(old, measure_elsewhere), old)
    assert found(report, Verdict.NOT_COMPARABLE) == {(ALL_CELLS, "fps")}

    def time_elsewhere(row: Row) -> None:
        row["provenance"]["timed"] = {"cpu": "Another CPU", "threads": 1}

    report = compare(changed(old, time_elsewhere), old)
    assert found(report, Verdict.NOT_COMPARABLE) == {(ALL_CELLS, "time")}


def test_an_unknown_machine_is_not_the_same_one(old: Rows) -> None:
    def forget(row: Row) -> None:
        del row["provenance"]["cpu"]

    unknown = changed(old, forget)
    assert (ALL_CELLS, "fps") in found(compare(unknown, unknown), Verdict.NOT_COMPARABLE)


def test_one_disturbed_lap_is_no_slower_training(old: Rows) -> None:
    def with_laps(row: Row) -> None:
        laps = [{"value": 1.0 + 0.1 * k, "calibration": 0.05} for k in range(8)]
        row["repeats"] = {"time": laps}

    before = changed(old, with_laps)
    after = deepcopy(before)
    for row in after:
        row["repeats"]["time"][3]["value"] *= 4
    assert (ALL_CELLS, "time") in found(compare(after, before), Verdict.SAME)
    slower = [planted.lose_speed(row) for row in after]
    assert (ALL_CELLS, "time") in found(compare(slower, before), Verdict.WORSE)


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.11, 0.2, Verdict.BETTER),
        (-0.2, -0.11, Verdict.WORSE),
        (-0.1, 0.1, Verdict.SAME),
        (-0.2, -0.05, Verdict.INCONCLUSIVE),
        (-math.inf, math.inf, Verdict.INCONCLUSIVE),
        (0.05, 0.2, Verdict.INCONCLUSIVE),
    ],
)
def test_an_interval_must_clear_the_margin(low: float, high: float, verdict: Verdict) -> None:
    assert verdict_of(Interval((low + high) / 2, low, high, 6), 0.1) == verdict


def test_speed_is_relative_to_the_workload_of_its_own_process(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "nobg", "3dgs")
    assert speed.calibrated(row, "time") == {"0": 42.0 / 0.5}
    assert speed.calibrated(row, "fps") == {"0": 59.0 * 0.5}
    row["metrics"]["fps_calibrated"] = 7.0
    assert speed.calibrated(row, "fps") == {"0": 7.0}
    row["repeats"] = {"fps": [{"value": 60.0, "calibration": 0.5}, {"value": 30, "calibration": 1}]}
    assert speed.calibrated(row, "fps") == {"0": 30.0, "1": 30.0}
