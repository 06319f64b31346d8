"""Runs become points and series that compare, and nothing else is joined."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from reports.gate.tolerances import TOLERANCES
from reports.history.series import CALIBRATED, METRICS, all_series, found_steps, points_of
from tests.reports.history.conftest import make_run

Run = dict[str, Any]
History = Callable[..., list[Run]]


def test_a_point_is_the_mean_of_its_seeds() -> None:
    runs = [make_run(0, {"psnr": 20.0 + seed}, seed=seed) for seed in (2, 0, 1)]
    (point,) = points_of(runs)
    assert point.value("psnr") == 21.0
    assert [run["seed"] for run in point.runs] == [0, 1, 2]


def test_the_same_code_run_again_is_another_point() -> None:
    again = make_run(0, {"psnr": 21.0}) | {"when": 1_760_000_009.0}
    assert len(points_of([make_run(0, {"psnr": 20.0}), again])) == 2


def test_a_failed_seed_leaves_a_point_without_a_value() -> None:
    runs = [make_run(0, {"psnr": 20.0}), make_run(0, {}, seed=1, status="failed")]
    (point,) = points_of(runs)
    assert point.value("psnr") is None


@pytest.mark.parametrize(
    "changes",
    [
        {"config_digest": "two"},
        {"seed": 7},
        {"inputs": '{"capture": "other"}'},
        {"protocol": "1"},
    ],
)
def test_what_does_not_compare_is_another_series(
    history_of: History, changes: dict[str, Any]
) -> None:
    old = history_of([24.0] * 5)
    later = {"when": 1.8e9, "timed_on": "server"}
    new = [run | later | changes for run in history_of([20.0] * 5)]
    found = all_series([*old, *new])
    assert [len(one.points) for one in found] == [5, 5]
    assert not found_steps(found), "a setting that changed is no step"


@pytest.mark.parametrize(("metric", "count"), [("fps_calibrated", 2), ("psnr", 1)])
def test_speed_is_one_series_a_machine_and_scores_are_not(
    history_of: History, metric: str, count: int
) -> None:
    runs = history_of([24.0] * 4, metric)
    other = [run | {"measured_on": "server", "when": run["when"] + 1} for run in runs]
    other = [run | {"git": run["git"] + "b"} for run in other]
    assert len(all_series([*runs, *other])) == count


def test_a_planted_loss_is_named_with_its_first_commit(history_of: History) -> None:
    rng = np.random.default_rng(0)
    values = [*(24 + rng.normal(0, 0.02, 6)), *(23.7 + rng.normal(0, 0.02, 4))]
    (found,) = found_steps(all_series(history_of(values)))
    assert (found.first.commit, found.last_before.commit) == ("00000006", "00000005")
    assert found.better is False
    assert found.step.before == pytest.approx(24, abs=0.03)
    assert found.step.after == pytest.approx(23.7, abs=0.03)


def test_a_failed_point_between_two_levels_is_not_the_first(history_of: History) -> None:
    runs = history_of([24.0] * 4 + [0.0] + [23.5] * 4)
    runs[4] |= {"status": "failed", "metrics": {}}
    (found,) = found_steps(all_series(runs))
    assert (found.first.commit, found.last_before.commit) == ("00000005", "00000003")


@pytest.mark.parametrize(
    ("metric", "factor", "better"),
    [("size_mb", 1.1, False), ("splats", 0.8, True), ("fps_calibrated", 0.9, False),
     ("time_calibrated", 0.9, True)],
)  # fmt: skip
def test_ratios_go_by_shares(history_of: History, metric: str, factor: float, better: bool) -> None:
    values = [1e-3] * 12 + [1e-3 * factor] * 12
    (found,) = found_steps(all_series(history_of(values, metric)))
    assert found.step.first == 12
    assert found.better is better
    assert found.step.after == pytest.approx(1e-3 * factor)


def test_plain_speed_has_no_steps(history_of: History) -> None:
    assert not found_steps(all_series(history_of([40.0] * 10 + [20.0] * 10, "fps")))


def test_a_lost_view_is_a_step(history_of: History) -> None:
    (found,) = found_steps(all_series(history_of([48] * 5 + [47] * 5, "registered")))
    assert found.step.first == 5


def test_every_number_that_the_gate_judges_has_a_chart() -> None:
    charted = {CALIBRATED.get(column.key, column.key) for column in METRICS}
    assert {tolerance.metric for tolerance in TOLERANCES} <= charted


def test_code_in_no_repository_is_named_by_its_digest(history_of: History) -> None:
    runs = history_of([1.0, 2.0])
    runs[0] |= {"git": "None", "code_version": "0123456789"}
    runs[1] |= {"git": "89abcdef01+changes"}
    assert [point.commit for point in points_of(runs)] == ["code 01234567", "89abcdef+"]
