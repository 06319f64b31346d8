"""What is gathered of one number in one cell, or why there is none to judge."""

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from statistics import fmean

import pytest

from reports.gate.numbers import Judged, collect, worst_view
from reports.gate.tolerances import TOLERANCES
from reports.rows.schema import Row, key_of

TABLE = {t.metric: t for t in TOLERANCES}


@pytest.fixture
def before(make_row: Callable[..., Row]) -> Row:
    return make_row("rover", "nobg", "3dgs")


def gathered(metric: str, after: Row, before: Row, **changes: float) -> Judged:
    """Return what is known of a metric that can be judged; ``changes`` of its tolerance."""
    tolerance = replace(TABLE[metric], **changes)  # type: ignore[arg-type]
    number, problem = collect(key_of(before), tolerance, [(after, before)])
    assert number is not None, problem
    assert not problem
    return number


def elsewhere(row: Row) -> Row:
    return row | {"provenance": row["provenance"] | {"cpu_kind": "another"}}


def test_both_sides_are_means_over_held_out_views(before: Row) -> None:
    after, losses = deepcopy(before), [place**2 for place in range(6)]
    for view, loss in zip(after["per_view"], losses, strict=True):
        view["psnr"] -= loss
    after["per_view"].append({"view": "train.jpg", "split": "train", "psnr": 99.0})
    number = gathered("psnr", after, before)
    assert number.before == pytest.approx(fmean(v["psnr"] for v in before["per_view"]))
    assert number.after == pytest.approx(number.before - fmean(losses))
    assert number.by_seed[0] == pytest.approx((-fmean(losses), 0.0))
    assert worst_view(number) == "0040.jpg"
    assert worst_view(gathered("size_mb", after, before)) is None, "a file has no views"


@pytest.mark.parametrize(
    ("ours", "theirs", "words"),
    [
        (None, 4.0, "missing in the candidate"),
        (4.0, None, "missing in the baseline"),
        (None, None, "missing in both"),
        (0.0, 4.0, "the candidate has 0: expected more than 0"),
        (4.0, -1.0, "the baseline has -1: expected more than 0"),
        (math.nan, 4.0, "a value is not finite"),
        (4.0, math.inf, "a value is not finite"),
    ],
)
def test_what_is_wrong_is_said_of_the_side_that_it_is_wrong_with(
    before: Row, ours: float | None, theirs: float | None, words: str
) -> None:
    def row(size: float | None) -> Row:
        return before | {"metrics": before["metrics"] | {"size_mb": size}}

    pair = row(ours), row(theirs)
    required, optional = (replace(TABLE["size_mb"], required=one) for one in (True, False))
    assert collect(key_of(before), required, [pair]) == (None, words)
    neither = ours is theirs is None  # nobody asked for it, and nobody has it
    assert collect(key_of(before), optional, [pair]) == (None, "" if neither else words)


def test_nobody_asks_for_scores_that_need_labels_or_true_masks_all_else_must_be_there(
    before: Row,
) -> None:
    views = [{"view": view["view"], "split": "test"} for view in before["per_view"]]
    bare = before | {"per_view": views, "metrics": {}, "registration": None, "masks": None}
    told = {t.metric: collect(key_of(before), t, [(bare, bare)])[1] for t in TOLERANCES}
    optional = {metric for metric, problem in told.items() if not problem}
    assert optional == {"paper_l1", "detail_psnr", "detail_ssim", "mean_iou"}


def test_laps_are_compared_as_far_as_both_have_them(before: Row) -> None:
    def laps(*seconds: float) -> Row:
        return before | {"repeats": {"time": [{"value": s, "calibration": 0.5} for s in seconds]}}

    number = gathered("time", laps(1.1, 2.2, 3.3, 9.0, 9.0), laps(1.0, 2.0, 3.0))
    assert number.by_seed[0] == pytest.approx((-math.log(1.1), 0.0))


def test_errors_that_rows_state_of_speeds_add_up_as_independent_ones_do(before: Row) -> None:
    def stated(error: float) -> Row:
        return before | {"metrics": before["metrics"] | {"fps_noise": error}}

    number = gathered("fps", stated(0.03), stated(0.04))
    assert number.errors == {0: pytest.approx(0.05)}
    assert number.by_seed[0][1] == pytest.approx(0.05)
    assert gathered("fps", stated(math.nan), before).errors == {0: 0.0}, "NaN states none"


def test_registered_views_are_draws_by_laplaces_rule_where_machines_differ(before: Row) -> None:
    def deviation(views: int, share: float) -> object:
        """Return the standard deviation of a binomial draw."""
        return pytest.approx(math.sqrt(views * share * (1 - share)))

    before["registration"] |= {"registered": 45, "views": 48}
    assert gathered("registered", before, before).noise == 0, "one machine finds them again"
    moved = elsewhere(before)
    assert gathered("registered", moved, before).noise == deviation(48, (45 + 1) / (48 + 2))
    assert gathered("registered", moved, before, between=0.7).noise == 0.7, "the baseline knows"
    del before["registration"]["views"]  # as in older rows: all, as far as they say
    assert gathered("registered", moved, before).noise == deviation(45, (45 + 1) / (45 + 2))


def test_noise_between_machines_is_the_baselines_for_exact_numbers_alone(before: Row) -> None:
    moved = elsewhere(before)
    assert gathered("mean_iou", moved, before).noise == 0, "nobody measured it"
    assert gathered("mean_iou", moved, before, between=0.02).noise == 0.02
    psnr = gathered("psnr", moved, before, between=0.2)
    assert (psnr.noise, psnr.moved) == (TABLE["psnr"].noise, True), "its interval weighs both"
