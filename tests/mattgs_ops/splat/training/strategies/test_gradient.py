"""A budgeted growth; what a threshold does is in test_densify and test_train."""

import itertools

from mattgs_ops.config import TrainConfig
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.strategies.gradient import budget_at


def test_a_budget_is_reached_by_the_last_densification() -> None:
    schedule = Schedule.of(TrainConfig(), 30_000, 1.0)
    due = [step for step in range(1, 30_001) if schedule.densifies(step)]
    counts = [budget_at(step, 1000, 9000, schedule) for step in due]
    assert counts[-1] == 9000
    assert all(a <= b for a, b in itertools.pairwise(counts))
    # a parabola: half way it has three quarters of what it adds
    middle = (schedule.densify_from + due[-1]) // 2
    assert budget_at(middle, 1000, 9000, schedule) == 7000
    assert budget_at(1, 1000, 9000, schedule) == 1000


def test_a_budget_below_the_start_adds_nothing() -> None:
    schedule = Schedule.of(TrainConfig(), 1000, 1.0)
    assert {budget_at(step, 500, 100, schedule) for step in (1, 300, 1000)} == {500}
