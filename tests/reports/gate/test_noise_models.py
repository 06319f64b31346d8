"""Each metric's noise model: noise of the size that it states raises no alarm, a loss does.

Rows are the committed baseline's, of one seed. Each draw moves every row by itself, as rounding
does; the values that a metric states are the standard deviations of one run.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from reports.gate import baseline
from reports.gate import compare as module
from reports.gate.compare import compare
from reports.gate.findings import ALL_CELLS, Verdict
from reports.gate.tolerances import SHARES, TOLERANCES, Tolerance, confidence
from reports.rows.schema import Row

DRAWS, LOSSES = 60, 20
MOST_FALSE = 1  # of so many draws; 1 % is what the gate allows for all metrics together
BETWEEN_FACTOR = 5.0  # noise between machines over that of the table, where a test makes one up
SHOWN = 6  # held-out views of a row: noise moves all of them alike, so their number tells nothing
VIEWS, SHARE = 48, 0.9  # of which so many register
SCORES = [t for t in TOLERANCES if t.kind == "difference"]
RATIOS = [t for t in TOLERANCES if t.kind == "ratio"]
SPEEDS = [t for t in TOLERANCES if t.kind == "speed"]
MORE_IS_BETTER = {"psnr", "ssim", "mask_psnr", "mask_ssim", "detail_psnr", "detail_ssim", "fps"}
Rows = list[Row]
Shift = Callable[[Row, float], Row]


def named(tolerances: list[Tolerance]) -> Any:
    return pytest.mark.parametrize("tolerance", tolerances, ids=lambda t: t.metric)


@pytest.fixture(scope="module")
def rows() -> Rows:
    """Return real rows of six cells, every metric of the table in them; nobody changes them."""
    found = []
    for row in baseline.load("quick-ci").rows:
        if row["seed"] == 0:
            views = [filled(view) for view in row["per_view"] if one_of(view)][:SHOWN]
            masks = {"mean_iou": 0.9, "source": "given"}
            found.append(row | {"per_view": views, "masks": masks})
    return found


def filled(view: Row) -> Row:
    """Return the view with a value for every score; captures without labels lack some."""
    return view | {t.metric: 0.5 for t in SCORES if view.get(t.metric) is None}


def one_of(view: Row) -> bool:
    return bool(view["split"] == "test")


@pytest.fixture
def only(monkeypatch: pytest.MonkeyPatch) -> Callable[[Tolerance], None]:
    """Return a function that leaves one metric in the gate's table."""
    return lambda one: monkeypatch.setattr("reports.gate.compare.TOLERANCES", (one,))


def moved(tolerance: Tolerance, row: Row, change: float) -> Row:
    """Return the row with one metric changed by so much; ratios by so much in their logarithm."""
    name = tolerance.metric
    if tolerance.kind == "difference":
        views = [view | {name: view[name] + change} if one_of(view) else view
                 for view in row["per_view"]]  # fmt: skip
        return row | {"per_view": views}
    if name == "mean_iou":
        return row | {"masks": row["masks"] | {name: row["masks"][name] + change}}
    factor = float(np.exp(change))
    if tolerance.kind == "ratio":
        return row | {"metrics": row["metrics"] | {name: row["metrics"][name] * factor}}
    ready = f"{name}_calibrated"
    if ready in row["metrics"]:
        return row | {"metrics": row["metrics"] | {ready: row["metrics"][ready] * factor}}
    laps = [lap | {"value": lap["value"] * factor} for lap in row["repeats"][name]]
    return row | {"repeats": {name: laps}}


def elsewhere(rows: Rows) -> Rows:
    return [row | {"provenance": row["provenance"] | {"cpu_kind": "another"}} for row in rows]


def alarms(
    rows: Rows, tolerance: Tolerance, sigma: float, loss: float = 0.0, *,
    shared: float = 0.0, noise: dict[str, float] | None = None, unlike: bool = False,
) -> int:  # fmt: skip
    """Count the draws in which the metric is called worse; both sides have noise."""
    count = 0
    for draw in range(LOSSES if loss else DRAWS):
        rng = np.random.default_rng(draw)
        both = [
            [moved(tolerance, row, rng.normal(0, sigma) + common) for row in rows]
            for common in rng.normal(0, shared, 2)
        ]
        new = [moved(tolerance, row, -tolerance.direction * loss) for row in both[0]]
        report = compare(elsewhere(new) if unlike else new, both[1], noise=noise)
        count += any(f.verdict == Verdict.WORSE for f in report.findings)
    return count


@named(SCORES + RATIOS)
def test_noise_of_the_table_is_no_loss_and_hides_none(
    rows: Rows, only: Callable[[Tolerance], None], tolerance: Tolerance
) -> None:
    only(tolerance)
    assert alarms(rows, tolerance, tolerance.noise) <= MOST_FALSE
    loss = 3 * tolerance.margin
    assert alarms(rows, tolerance, tolerance.noise, loss) == LOSSES


@named([*SCORES, *RATIOS])
@pytest.mark.parametrize("unlike", [False, True])
def test_noise_of_the_baseline_is_no_loss(
    rows: Rows, only: Callable[[Tolerance], None], tolerance: Tolerance, unlike: bool
) -> None:
    """On one machine it is that of an edit that rounds otherwise."""
    only(tolerance)
    sigma = BETWEEN_FACTOR * tolerance.noise
    noise = {tolerance.metric: sigma}
    assert alarms(rows, tolerance, sigma, noise=noise, unlike=unlike) <= MOST_FALSE
    loss = tolerance.margin + 6 * sigma
    assert alarms(rows, tolerance, sigma, loss, noise=noise, unlike=unlike) == LOSSES


@named(SPEEDS)
def test_noise_of_speed_is_no_slowdown(
    rows: Rows, only: Callable[[Tolerance], None], tolerance: Tolerance
) -> None:
    """Each run has its own, and all runs of one gate share some."""
    only(tolerance)
    sigma, shared = tolerance.noise, tolerance.common
    assert alarms(rows, tolerance, sigma, shared=shared) <= MOST_FALSE
    assert alarms(rows, tolerance, sigma, 0.15, shared=shared) >= 0.95 * LOSSES


def test_noise_of_mask_iou_counts_between_machines_alone(
    rows: Rows, only: Callable[[Tolerance], None]
) -> None:
    (tolerance,) = [t for t in TOLERANCES if t.metric == "mean_iou"]
    only(tolerance)
    noise = {"mean_iou": 0.01}
    assert alarms(rows, tolerance, 0.01, noise=noise, unlike=True) <= MOST_FALSE
    assert alarms(rows, tolerance, 0.01, 0.1, noise=noise, unlike=True) == LOSSES
    assert alarms(rows, tolerance, 0.0, 0.006, noise=noise) == LOSSES, "here the IoU is exact"
    assert alarms(rows, tolerance, 0.0, 0.004, noise=noise) == 0


def test_registered_views_are_draws_between_machines_and_exact_on_one(
    rows: Rows, only: Callable[[Tolerance], None]
) -> None:
    (tolerance,) = [t for t in TOLERANCES if t.metric == "registered"]
    only(tolerance)

    def registered(count: int) -> Rows:
        poses = {"registered": count, "views": VIEWS}
        return [row | {"registration": poses} for row in rows]

    def worse(new: int, old: int, *, unlike: bool) -> bool:
        candidate = elsewhere(registered(new)) if unlike else registered(new)
        report = compare(candidate, registered(old))
        return any(f.verdict == Verdict.WORSE for f in report.findings)

    draws = np.random.default_rng(0).binomial(VIEWS, SHARE, (DRAWS, 2))
    assert sum(worse(int(a), int(b), unlike=True) for a, b in draws) <= MOST_FALSE
    assert worse(VIEWS // 3, round(VIEWS * SHARE), unlike=True)
    assert all(worse(int(a), int(b), unlike=False) == (a < b) for a, b in draws[:20])


@named([*SCORES, *RATIOS, *SPEEDS])
def test_a_gain_is_more_of_what_is_good_and_less_of_what_is_bad(
    rows: Rows, only: Callable[[Tolerance], None], tolerance: Tolerance
) -> None:
    only(tolerance)
    gain = 0.3 if tolerance.metric in MORE_IS_BETTER else -0.3
    for change, verdict, told in ((gain, Verdict.BETTER, 0.3), (-gain, Verdict.WORSE, -0.3)):
        report = compare([moved(tolerance, row, change) for row in rows], rows)
        (finding,) = [f for f in report.findings if f.cell == ALL_CELLS]
        assert finding.verdict == verdict
        assert finding.change is not None
        share = told if tolerance.kind == "difference" else np.expm1(told)
        assert finding.change.mean == pytest.approx(share)


@pytest.mark.parametrize("numbers", [1, 7])
def test_chances_of_a_false_alarm_add_up_to_one_percent(numbers: int) -> None:
    """Whatever how many numbers a family has; an alarm is one end of a two-sided interval."""
    chances = [numbers * (1 - confidence(*family, numbers)) / 2 for family in SHARES]
    assert sum(chances) == pytest.approx(0.01)


def test_over_all_cells_an_alarm_is_shared_among_no_fewer_numbers_than_there_are(
    old: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared: dict[str, int] = {}

    def heard(aspect: str, scope: str, checks: int) -> float:
        if scope == "all":
            shared[aspect] = checks
        return 0.99

    monkeypatch.setattr(module, "confidence", heard)
    report = compare(old, old)
    for aspect, checks in shared.items():
        assert checks >= sum(f.cell == ALL_CELLS and f.aspect == aspect for f in report.findings)
    assert (shared["cost"], shared["size"]) == (2, 2)


def test_every_metric_of_the_table_is_tried() -> None:
    tried = {t.metric for t in SCORES + RATIOS + SPEEDS} | {"mean_iou", "registered"}
    assert tried == {t.metric for t in TOLERANCES}
