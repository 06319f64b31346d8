"""What cannot be compared is never called the same."""

import math
from collections.abc import Callable
from copy import deepcopy

import pytest

from reports.gate.compare import compare
from reports.gate.findings import Exit, Verdict
from reports.rows.schema import Row
from tests.reports.gate.conftest import Rows, found, poison, shift_views


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


def other_truth(row: Row) -> None:
    row["digests"] = row["digests"] | {"truth": "d2"}


def other_views_and_truth(row: Row) -> None:
    other_views(row)
    other_truth(row)


@pytest.mark.parametrize(
    ("change", "told", "judged"),
    [
        (other_config, "rows", set()),  # nothing of another experiment compares
        (other_views, "rows", {"registered", "mean_iou"}),
        (other_truth, "truth", {"registered", "mean_iou"}),
        (other_views_and_truth, "rows", {"registered", "mean_iou"}),
    ],
)
def test_scores_of_other_views_or_truth_leave_poses_and_masks_to_be_judged(
    old: Rows, change: Callable[[Row], None], told: str, judged: set[str]
) -> None:
    rows = deepcopy(old[:1])
    change(rows[0])
    report = compare(rows, old[:1])
    assert {metric for _, metric in found(report, Verdict.NOT_COMPARABLE)} == {told}
    assert {f.metric for f in report.findings if f.change is not None} == judged


def trained(row: Row, *names: str) -> Row:
    """Return the row as one that names all photos it was trained on, of which few were scored."""
    return row | {"trained_on": list(names)}


def reason(new: Row, old: Row) -> str:
    return "; ".join(f.reason for f in compare([new], [old]).findings if f.metric == "rows")


def test_an_input_that_one_side_alone_had_is_another_input(old: Rows) -> None:
    inputs = old[0]["provenance"]["inputs"] | {"masks": "d9"}
    masked = old[0] | {"provenance": old[0]["provenance"] | {"inputs": inputs}}
    assert reason(masked, old[0]) == reason(old[0], masked) == "other inputs: masks"
    assert not reason(masked, masked)


def test_held_out_views_that_one_side_lacks_are_named(old: Rows) -> None:
    fewer = old[0] | {"per_view": old[0]["per_view"][:1]}
    names = "0008.jpg, 0016.jpg, 0024.jpg, 0032.jpg and 1 more"
    assert reason(old[0], fewer) == f"other held-out views: {names}"
    assert reason(fewer, old[0]) == f"held-out views are missing: {names}"


def test_a_leak_of_a_view_that_was_not_scored_is_named(old: Rows) -> None:
    held_out = next(v["view"] for v in old[0]["per_view"] if v["split"] == "test")
    healthy = trained(old[0], "a.jpg", "b.jpg")
    leaked = trained(old[0], "a.jpg", "b.jpg", held_out)
    assert not reason(healthy, healthy)
    expected = f"held-out views were trained on: {held_out}; other training views: {held_out}"
    assert reason(leaked, healthy) == expected
    assert f"held-out views were trained on: {held_out}" in reason(leaked, old[0])


def test_a_sample_of_training_views_compares_with_all_of_them(old: Rows) -> None:
    """Rows of earlier versions name the training views that were scored."""
    sample = old[0] | {"per_view": [*old[0]["per_view"], {"view": "a.jpg", "split": "train"}]}
    assert not reason(trained(old[0], "a.jpg", "b.jpg"), sample)
    assert not reason(sample, trained(old[0], "a.jpg", "b.jpg"))
    assert reason(trained(old[0], "b.jpg"), sample) == "other training views: a.jpg"
    assert reason(sample, trained(old[0], "b.jpg")) == "other training views: a.jpg"
    others = trained(old[0], "a.jpg", "c.jpg"), trained(old[0], "a.jpg", "b.jpg")
    assert reason(*others) == "other training views: b.jpg, c.jpg"


def of_seed(seed: int, row: Row) -> Row:
    return row | {"seed": seed}


def status_of(new: Rows, old: Rows) -> tuple[Verdict, str, int]:
    report = compare(new, old)
    (finding,) = [f for f in report.findings if f.metric in ("status", "rows")]
    return finding.verdict, finding.reason, report.exit_code


def test_seeds_that_fail_are_told_also_where_others_finished(
    old: Rows, make_failed: Callable[..., Row]
) -> None:
    finished = [old[0], of_seed(1, old[0])]
    failed = of_seed(2, make_failed("rover", "original", "3dgs", "out of memory"))
    both = [*finished, failed]
    told = "seed 2: out of memory"
    assert status_of(both, both) == (Verdict.STILL_FAILING, told, Exit.PASS)
    why = f"{told} (the baseline has no such seed)"
    assert status_of(both, finished) == (Verdict.NOT_COMPARABLE, why, Exit.CANNOT_JUDGE)
    three = [*finished, of_seed(2, old[0])]
    assert status_of(both, three) == (Verdict.NEWLY_FAILING, told, Exit.FAILED_RUNS)


def test_an_experiment_with_two_rows_is_not_judged_whichever_comes_last(old: Rows) -> None:
    worse = deepcopy(old[0])
    shift_views(worse, psnr=-8.0)
    for twice in ([old[0], worse], [worse, old[0]]):
        for sides, where in (((twice, old[:1]), "candidate"), ((old[:1], twice), "baseline")):
            why = f"seed 0 appears 2 times in the {where}"
            assert status_of(*sides) == (Verdict.NOT_COMPARABLE, why, Exit.CANNOT_JUDGE)


def test_the_same_bits_are_the_same_also_of_one_view(old: Rows) -> None:
    """A capture of up to eight photos has one held-out view, which shows no spread."""
    rows = [row | {"per_view": row["per_view"][:1]} for row in old]
    report = compare(rows, rows)
    assert {f.verdict for f in report.findings if f.aspect == "quality"} == {Verdict.SAME}
    assert report.exit_code == Exit.PASS
    moved = deepcopy(rows)
    shift_views(moved[0], psnr=0.001)
    told = {f.verdict for f in compare(moved[:1], rows[:1]).findings if f.metric == "psnr"}
    assert told == {Verdict.INCONCLUSIVE}, "one view that changed says nothing of others"
