"""The gate's verdicts: planted changes are named on the right metric, and nothing else is."""

import math
from collections.abc import Callable
from copy import deepcopy

import pytest

from reports.gate import compare as module
from reports.gate import planted
from reports.gate.compare import compare, exit_code, verdict_of
from reports.gate.findings import ALL_CELLS, Exit, Finding, Verdict
from reports.gate.tolerances import Doubt
from reports.rows.schema import Row
from reports.rows.statistics import Interval
from tests.reports.gate.conftest import Rows, changed, found, jittered, shift_views


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


def test_an_experiment_that_is_new_is_none_that_was_fixed(old: Rows) -> None:
    report = compare([*old, old[0] | {"seed": 1}], old)
    assert not found(report, Verdict.FIXED)
    assert report.exit_code == Exit.PASS


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


CELL = "rover/nobg-ours@1000x320"
JUDGED = Finding(CELL, "quality", "psnr", Verdict.SAME)
EXCUSED = Finding(CELL, "cost", "fps", Verdict.NOT_COMPARABLE, excused=True)


def of_run(verdict: Verdict) -> Finding:
    return Finding(CELL, "run", "status", verdict)


def doubtful(metric: str, mean: float, cell: str = CELL) -> Finding:
    """Return a finding in doubt, whose margin is 0.1."""
    aspect, change = "cost" if metric == "time" else "quality", Interval(mean, -9.0, 9.0, 6)
    return Finding(cell, aspect, metric, Verdict.INCONCLUSIVE, change=change, margin=0.1)


@pytest.mark.parametrize(
    ("findings", "codes"),
    [  # codes by doubt: a loss beyond its margin, all, none
        ([JUDGED], (0, 0, 0)),
        ([Finding(CELL, "quality", "ssim", Verdict.BETTER)], (0, 0, 0)),
        ([Finding(CELL, "size", "size_mb", Verdict.SAME)], (2, 2, 2)),  # no score was judged
        ([doubtful("psnr", 0.0)], (2, 2, 2)),
        ([JUDGED, doubtful("psnr", -0.1)], (0, 2, 0)),
        ([JUDGED, doubtful("psnr", -0.11)], (2, 2, 0)),
        ([JUDGED, doubtful("time", -0.2)], (0, 2, 0)),  # one cell's speed is too noisy to count
        ([JUDGED, doubtful("time", -0.2, ALL_CELLS)], (2, 2, 0)),
        ([JUDGED, EXCUSED], (0, 2, 0)),
        ([JUDGED, of_run(Verdict.NOT_COMPARABLE)], (2, 2, 2)),
        ([JUDGED, of_run(Verdict.FIXED), of_run(Verdict.STILL_FAILING)], (0, 0, 0)),
        ([JUDGED, of_run(Verdict.NEWLY_FAILING), EXCUSED], (3, 3, 3)),
        ([Finding(CELL, "size", "splats", Verdict.WORSE)], (1, 1, 1)),
    ],
)
def test_an_exit_code_follows_from_the_findings_and_the_doubt_asked_for(
    findings: list[Finding], codes: tuple[int, int, int]
) -> None:
    asked = (Doubt.MARGIN, Doubt.ALL, Doubt.NONE)
    assert tuple(exit_code(findings, doubt) for doubt in asked) == codes


def test_three_cells_have_a_mean_and_exact_numbers_none(old: Rows) -> None:
    def pooled(rows: list[Row]) -> set[str]:
        return {f.metric for f in compare(rows, rows).findings if f.cell == ALL_CELLS}

    scores = {"psnr", "ssim", "l1", "mask_psnr", "mask_ssim", "mask_l1"}
    assert pooled(old[:2]) == set()
    assert pooled(old[:3]) == scores | {"time", "fps", "size_mb", "splats"}


def test_the_chance_of_an_alarm_is_shared_among_the_numbers_that_have_one(
    old: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = set()

    def confidence(aspect: str, scope: str, checks: int) -> float:
        if scope == "cell":
            asked.add((aspect, checks))
        return 0.99

    monkeypatch.setattr(module, "confidence", confidence)
    compare(old, old)
    cells, exact = 12, 2  # masks and poses, which one machine finds again to the bit
    assert asked == {("quality", 6 * cells), ("cost", 2 * cells), ("size", 2 * cells)}
    asked.clear()
    moved = deepcopy(old)
    for row in moved:
        row["provenance"]["cpu_kind"] = "another"
    compare(moved, old, noise={"mean_iou": 0.01})
    assert ("quality", (6 + exact) * cells) in asked, "between machines these have a noise, too"
