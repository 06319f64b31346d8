"""The published schedule at 30,000 steps, and what shorter runs make of it."""

import math
from itertools import pairwise

import pytest

from mattgs_ops.config import TrainConfig
from mattgs_ops.splat.training.schedule import Schedule

EXTENT = 4.0


def events(schedule: Schedule) -> tuple[list[int], list[int]]:
    steps = range(1, schedule.iterations + 1)
    return [s for s in steps if schedule.densifies(s)], [s for s in steps if schedule.resets(s)]


def test_thirty_thousand_steps_are_the_published_schedule() -> None:
    schedule = Schedule.of(TrainConfig(), 30_000, EXTENT)
    densifies, resets = events(schedule)
    assert densifies == list(range(600, 15_000, 100))
    assert resets == [3000, 6000, 9000, 12_000]
    assert [schedule.degree(s) for s in (1, 999, 1000, 2000, 3000, 30_000)] == [0, 0, 1, 2, 3, 3]


def test_positions_learn_ever_slower_by_a_constant_factor() -> None:
    schedule = Schedule.of(TrainConfig(), 30_000, EXTENT)
    assert schedule.position_rate(0) == pytest.approx(1.6e-4 * EXTENT)
    assert schedule.position_rate(15_000) == pytest.approx(1.6e-5 * EXTENT)
    assert schedule.position_rate(30_000) == pytest.approx(1.6e-6 * EXTENT)


def test_other_rates_stay_or_fall_to_the_share_asked_for_late_in_long_trainings() -> None:
    long, short = (Schedule.of(TrainConfig(), steps, EXTENT) for steps in (10_000, 1000))
    assert {long.rate_share(step, 1.0) for step in (1, 5000, 10_000)} == {1.0}
    assert {long.rate_share(step, 0.04) for step in (1, 2000, 3000)} == {1.0}
    assert long.rate_share(6500, 0.04) == pytest.approx(0.2)
    assert long.rate_share(10_000, 0.04) == pytest.approx(0.04)
    assert short.rate_share(1000, 0.04) == 1.0
    assert Schedule.of(TrainConfig(), 4000, EXTENT).rate_share(3000, 0.04) == pytest.approx(0.2)


def test_half_the_steps_halve_the_schedule() -> None:
    schedule = Schedule.of(TrainConfig(), 15_000, EXTENT)
    assert schedule.sh_every == 500
    assert schedule.densify_until == 7500
    assert schedule.reset_every == 1500
    assert schedule.position_rate(15_000) == pytest.approx(1.6e-6 * EXTENT)


def test_without_scaling_a_shorter_run_just_ends_earlier() -> None:
    long = Schedule.of(TrainConfig(), 30_000, EXTENT)
    short = Schedule.of(TrainConfig(scale_schedule=False), 4000, EXTENT)
    for step in range(1, 4000):
        assert short.position_rate(step) == pytest.approx(long.position_rate(step))
        assert short.densifies(step) == long.densifies(step)
        assert short.resets(step) == long.resets(step)
        assert short.degree(step) == long.degree(step)


@pytest.mark.parametrize("iterations", [700, 3000, 6000, 14_900])
def test_the_last_step_neither_splits_nor_resets_what_is_saved_then(iterations: int) -> None:
    schedule = Schedule.of(TrainConfig(scale_schedule=False), iterations, EXTENT)
    assert not schedule.densifies(iterations)
    assert not schedule.resets(iterations)
    assert schedule.densifies(iterations - 100)
    scaled = Schedule.of(TrainConfig(densify_until=40_000), iterations, EXTENT)
    assert not scaled.densifies(iterations)
    mcmc = Schedule.of(TrainConfig(scale_schedule=False), iterations, EXTENT, mcmc=True)
    assert not mcmc.densifies(iterations)


def test_resets_stay_where_densification_would_last_longer_than_the_run() -> None:
    assert Schedule.of(TrainConfig(densify_until=40_000), 30_000, EXTENT).reset_every == 3000


@pytest.mark.parametrize(
    ("iterations", "sh_every", "begin", "until", "every", "reset"),
    [
        (300, 25, 29, 225, 30, 0),  # every tenth of the run, for three quarters of it
        (1000, 33, 99, 750, 100, 0),  # from here on a hundred steps apart
        (2999, 100, 99, 2249, 100, 0),  # a reset at 2,000 would have 999 steps to heal
        (3000, 100, 99, 2250, 100, 1000),
        (4000, 133, 99, 2500, 100, 1000),  # three quarters, but not beyond 2,500
        (7000, 233, 117, 3500, 100, 1000),  # half of the run
        (30_000, 1000, 500, 15_000, 100, 3000),  # as published
        (60_000, 2000, 1000, 30_000, 200, 6000),
    ],
)
def test_floors_and_ceilings_bind_where_a_run_is_too_short_for_the_published_schedule(
    iterations: int, sh_every: int, begin: int, until: int, every: int, reset: int
) -> None:
    found = Schedule.of(TrainConfig(), iterations, EXTENT)
    assert (found.sh_every, found.densify_from, found.densify_until) == (sh_every, begin, until)
    assert (found.densify_every, found.reset_every) == (every, reset)
    assert [found.observes(step) for step in (1, until - 1, until)] == [True, True, False]


@pytest.mark.parametrize(
    ("iterations", "scaled", "begin", "until", "every"),
    [
        (1000, True, 19, 833, 20),  # at least 20 steps apart
        (10_000, True, 167, 8333, 33),  # a third of the published steps
        (30_000, True, 500, 25_000, 100),
        (1000, False, 500, 25_000, 100),
    ],
)
def test_mcmc_relocates_by_its_own_steps_and_never_resets(
    iterations: int, scaled: bool, begin: int, until: int, every: int
) -> None:
    found = Schedule.of(TrainConfig(scale_schedule=scaled), iterations, EXTENT, mcmc=True)
    assert (found.densify_from, found.densify_until, found.densify_every) == (begin, until, every)
    assert found.reset_every == 0


@pytest.mark.parametrize("iterations", [300, 500, 1000, 1300])
def test_short_runs_still_densify_and_never_reset(iterations: int) -> None:
    schedule = Schedule.of(TrainConfig(), iterations, EXTENT)
    densifies, resets = events(schedule)
    assert len(densifies) >= 3
    assert densifies[-1] <= 0.9 * iterations, "what was added last needs time to settle"
    assert not resets
    assert schedule.degree(iterations) == 3


@pytest.mark.parametrize("iterations", [2000, 3000, 5000, 7000, 10_000, 20_000, 30_000, 60_000])
def test_resets_leave_time_to_heal(iterations: int) -> None:
    _, resets = events(Schedule.of(TrainConfig(), iterations, EXTENT))
    assert all(later - reset >= 1000 for reset, later in pairwise([*resets, iterations]))


@pytest.mark.parametrize("iterations", [1, 2, 10, 99])
def test_the_shortest_runs_do_not_break(iterations: int) -> None:
    schedule = Schedule.of(TrainConfig(), iterations, EXTENT)
    densifies, resets = events(schedule)
    assert not resets
    assert all(math.isfinite(schedule.position_rate(s)) for s in range(iterations + 1))
    assert all(s < iterations for s in densifies)


def test_floors_never_exceed_what_was_configured() -> None:
    config = TrainConfig(densify_every=10, densify_from=20, sh_every=5)
    schedule = Schedule.of(config, 1000, EXTENT)
    assert (schedule.densify_every, schedule.densify_from, schedule.sh_every) == (10, 20, 5)


def test_low_opacity_means_something_half_an_interval_after_a_reset() -> None:
    schedule = Schedule.of(TrainConfig(), 30_000, EXTENT)
    assert schedule.since_reset(2999) == 2999
    assert schedule.since_reset(3000) == 0
    assert [schedule.settled(s) for s in (3000, 4400, 4500, 5900, 6000)] == [
        *(False, False, True, True, False)
    ]
    assert schedule.since_reset(20_000) == 8000, "the last reset was at 12,000"
    assert Schedule.of(TrainConfig(), 1000, EXTENT).settled(1), "never reset, always settled"
