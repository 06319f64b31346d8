"""The gate's verdicts: planted changes are named on the right metric, and nothing else is."""

import json
import math
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
from PIL import Image

from mattgs_ops.errors import InputError
from reports.gate import output, pictures, planted, self_check, speed
from reports.gate.compare import compare, verdict_of
from reports.gate.findings import ALL_CELLS, Exit, Finding, GateReport, Verdict
from reports.gate.tolerances import Doubt
from reports.rows import statistics
from reports.rows.schema import Row
from reports.rows.statistics import Interval

SCHEMA = Path(output.__file__).with_name("schema.json")
Rows = list[Row]


@pytest.fixture
def old(make_grid: Callable[..., Rows]) -> Rows:
    return make_grid()


def jittered(rows: Rows, decibels: float = 0.02, seed: int = 1) -> Rows:
    """Another run of the same code on another machine: a little different everywhere."""
    rng = np.random.default_rng(seed)
    out = deepcopy(rows)
    for row in out:
        for view in row["per_view"]:
            for name in ("psnr", "mask_psnr"):
                view[name] += rng.normal(0, decibels)
        for name in ("time", "fps"):
            row["metrics"][name] *= math.exp(rng.normal(0, 0.01))
    return out


def changed(
    rows: Rows, change: Callable[[Row], None], only: Callable[[Row], bool] = lambda _: True
) -> Rows:
    out = jittered(rows)
    for row in out:
        if only(row):
            change(row)
    return out


def found(report: GateReport, verdict: Verdict) -> set[tuple[str, str]]:
    return {(f.cell, f.metric) for f in report.findings if f.verdict == verdict}


def shift_views(row: Row, **shifts: float) -> None:
    for view in row["per_view"]:
        for name, shift in shifts.items():
            view[name] += shift


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


def poison(row: Row) -> None:
    row["metrics"]["psnr"] = math.nan


def forget(row: Row) -> None:
    del row["metrics"]["size_mb"]


def one_view_lacks(row: Row) -> None:
    del row["per_view"][0]["mask_psnr"]


def infinite_view(row: Row) -> None:
    row["per_view"][0]["psnr"] = math.inf


def without_calibration(row: Row) -> None:
    row["provenance"]["calibration"] = None


def other_protocol(row: Row) -> None:
    row["provenance"]["protocol"] = 2


def other_config(row: Row) -> None:
    row["provenance"]["config_digest"] = "other"


def other_inputs(row: Row) -> None:
    row["provenance"]["inputs"] = {"capture": "d2"}


def other_views(row: Row) -> None:
    row["per_view"] = row["per_view"][1:]


@pytest.mark.parametrize(
    ("change", "verdict", "code"),
    [
        (poison, Verdict.NEWLY_FAILING, Exit.FAILED_RUNS),
        (forget, Verdict.NEWLY_FAILING, Exit.FAILED_RUNS),
        (one_view_lacks, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (infinite_view, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (without_calibration, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_protocol, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_config, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_inputs, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
        (other_views, Verdict.NOT_COMPARABLE, Exit.CANNOT_JUDGE),
    ],
)
def test_what_cannot_be_compared_is_never_the_same(
    old: Rows, change: Callable[[Row], None], verdict: Verdict, code: int
) -> None:
    rows = deepcopy(old)
    change(rows[0])
    report = compare(rows, old)
    cell = "rover/original-3dgs@1000x320"
    assert cell in {name for name, _ in found(report, verdict)}
    assert report.exit_code == code


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
    assert known.exit_code == Exit.CANNOT_JUDGE


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


def test_json_follows_its_schema(old: Rows) -> None:
    for rows in (old, old[4:], changed(old, poison)):
        document = json.loads(output.to_json(compare(rows, old)))
        jsonschema.validate(document, json.loads(SCHEMA.read_text()))


def test_junit_counts_what_it_holds(old: Rows) -> None:
    rows = changed(old, lambda row: shift_views(row, psnr=-2.0))
    root = ElementTree.fromstring(output.junit(compare(rows, old)))
    assert len(root) == 13
    for suite in root:
        assert int(suite.get("tests", 0)) == len(suite.findall("testcase"))
        assert int(suite.get("failures", 0)) == len(suite.findall("testcase/failure")) >= 1
    first = root[0].find("testcase/failure")
    assert root[0].get("name") == ALL_CELLS
    assert first is not None
    assert "worse" in str(first.get("message"))


def test_people_read_the_worst_first(old: Rows) -> None:
    rows = changed(old, lambda row: shift_views(row, psnr=-0.5))
    rows[3]["per_view"][2]["psnr"] -= 0.8
    shift_views(rows[3], psnr=-3.0)
    report = compare(rows, old)
    assert report.findings[0].worst_view == "0016.jpg"
    text = output.terminal(report)
    assert text.startswith("Gate: regression.")
    assert "rover/nobg-ours" in text.splitlines()[4]
    assert max(map(len, text.splitlines())) <= 110
    summary = output.markdown(report, [("View 0016.jpg", "worst.png")])
    assert "**worse**" in summary
    assert "![View 0016.jpg](worst.png)" in summary


def test_a_quiet_gate_says_how_well_it_sees_and_no_more(old: Rows) -> None:
    first, second = output.terminal(compare(old, old)).splitlines()
    assert first.startswith("Gate: pass.")
    assert second.startswith("A loss in all cells would be named from: PSNR 0.10 dB, ")


def test_the_self_check_trusts_the_gate_on_quiet_rows(old: Rows) -> None:
    runs = [jittered(old, seed=seed) for seed in (2, 3, 4)]
    result = self_check.self_check(runs, comparisons=20)
    assert result.trusted
    assert result == self_check.self_check(runs, comparisons=20)
    assert "the gate may be trusted" in self_check.told(result)


def test_the_self_check_does_not_trust_it_on_rows_that_jump(old: Rows) -> None:
    runs = [jittered(old, 1.0, seed=seed) for seed in (2, 3)]
    wild = self_check.self_check(runs, comparisons=12)
    assert wild.resampled.false_alarms.share < 0.1
    assert not wild.trusted
    assert "may not be trusted" in self_check.told(wild)


def test_a_self_check_needs_two_runs_of_the_same_grid(old: Rows) -> None:
    with pytest.raises(InputError, match="same finished experiments"):
        self_check.self_check([old, old[1:]])
    with pytest.raises(InputError, match="two runs or more"):
        self_check.self_check([old])


def test_findings_know_how_bad_they_are() -> None:
    bad = Finding(
        "c", "quality", "psnr", Verdict.WORSE, change=statistics.sample([-0.4, -0.4]), margin=0.1
    )
    assert bad.severity == pytest.approx(-4)


def test_everything_is_written_for_machines_and_people(
    pictured: tuple[Rows, Path], tmp_path: Path
) -> None:
    old, root = pictured
    rows = changed(
        old, lambda row: shift_views(row, psnr=-2.0), lambda row: row["method"] == "ours"
    )
    report = compare(rows, old)
    shown = pictures.draw(report, rows, root, tmp_path, baseline=old, baseline_root=root)
    assert [name for _, name in shown] == ["gate-1.png", "gate-2.png"]
    with Image.open(tmp_path / "gate-1.png") as image:
        assert image.size == (4 * 96 + 3 * pictures.GAP, 72)
    paths = output.write(report, tmp_path, shown)
    assert set(paths) == {"md", "xml", "json"}
    assert "](gate-1.png)" in paths["md"].read_text()
    assert pictures.draw(report, rows, None, tmp_path) == []
