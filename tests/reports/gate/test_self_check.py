"""How often the gate errs: independent runs are counted as such, and rates have bounds."""

from math import comb

import pytest

from mattgs_ops.errors import InputError
from reports.gate.self_check import (
    CONFIDENCE,
    PLANTED,
    Outcome,
    Rate,
    SelfCheck,
    independent,
    markdown,
    rates_of,
    self_check,
)
from tests.reports.gate.conftest import Rows, jittered, shift_views


@pytest.mark.parametrize("count", [2, 3, 8, 9])
def test_each_run_is_compared_once(old: Rows, count: int) -> None:
    runs = [[{**old[0], "run_id": str(number)}] for number in range(count)]
    pairs = independent(runs)
    assert len(pairs) == count // 2, "however many could be drawn"
    used = [rows[0]["run_id"] for pair in pairs for rows in pair]
    assert len(used) == len(set(used))
    assert all(int(new[0]["run_id"]) == int(base[0]["run_id"]) + 1 for new, base in pairs)


def test_resampling_adds_no_independent_comparison(old: Rows) -> None:
    runs = [jittered(old, seed=seed) for seed in range(5)]
    result = self_check(runs, comparisons=20)
    assert result.runs == 5
    assert result.independent.false_alarms.trials == 2
    assert result.resampled.false_alarms.trials == 20
    assert "5 runs are 2 independent comparisons: 0 false alarms" in markdown(result)


def at_most(hits: int, trials: int, rate: float) -> float:
    """Return the chance of so many hits or fewer, term by term."""
    return sum(comb(trials, k) * rate**k * (1 - rate) ** (trials - k) for k in range(hits + 1))


@pytest.mark.parametrize(("hits", "trials"), [(0, 2), (0, 300), (1, 30), (7, 40), (39, 40)])
def test_a_bound_is_the_rate_at_which_so_few_or_so_many_would_be_a_surprise(
    hits: int, trials: int
) -> None:
    rate = Rate(hits, trials)
    assert at_most(hits, trials, rate.most) == pytest.approx(1 - CONFIDENCE)
    if hits:
        assert 1 - at_most(hits - 1, trials, rate.least) == pytest.approx(1 - CONFIDENCE)
    assert rate.least <= rate.share <= rate.most


def test_three_hundred_comparisons_bound_a_rate_below_one_per_cent_two_hundred_do_not() -> None:
    assert Rate(0, 300).most == pytest.approx(3 / 300, rel=0.01)
    assert Rate(0, 300).most < 0.01 < Rate(0, 200).most
    assert (Rate(40, 40).most, Rate(0, 40).least) == (1.0, 0.0)


def test_alarms_of_unchanged_code_are_counted_by_comparison_and_by_metric(old: Rows) -> None:
    worse = jittered(old)
    for row in worse:
        shift_views(row, psnr=-1.0, mask_psnr=-1.0)
    outcome = rates_of([(jittered(old), old), (worse, old), (jittered(old, seed=2), old)])
    assert (outcome.false_alarms.hits, outcome.false_alarms.trials) == (1, 3)
    assert outcome.alarms == {"psnr": 1, "mask_psnr": 1}
    assert all(rate.trials == 3 for rate in outcome.caught.values())


def test_the_self_check_trusts_the_gate_on_quiet_rows(old: Rows) -> None:
    runs = [jittered(old, seed=seed) for seed in (2, 3, 4)]
    result = self_check(runs, comparisons=20)
    assert result.trusted
    assert result == self_check(runs, comparisons=20)
    assert "the gate may be trusted" in markdown(result)


def test_the_self_check_does_not_trust_it_on_rows_that_jump(old: Rows) -> None:
    runs = [jittered(old, 1.0, seed=seed) for seed in (2, 3)]
    wild = self_check(runs, comparisons=12)
    assert wild.resampled.false_alarms.share < 0.1
    assert not wild.trusted
    assert "may not be trusted" in markdown(wild)


def outcome(alarms: int, caught: int, trials: int) -> Outcome:
    """Return so many false alarms, and so many catches of one planted loss, all of the others."""
    first, *others = PLANTED
    rates = {first: Rate(caught, trials)} | dict.fromkeys(others, Rate(trials, trials))
    return Outcome(Rate(alarms, trials), Rate(0, trials), rates, {})


@pytest.mark.parametrize(
    ("alone", "drawn", "trusted"),
    [
        ((0, 4, 4), (0, 200, 200), True),
        # of what was drawn: under 1 % false, at least 95 % caught
        ((0, 4, 4), (1, 200, 200), True),
        ((0, 4, 4), (2, 200, 200), False),
        ((0, 4, 4), (0, 190, 200), True),
        ((0, 4, 4), (0, 189, 200), False),
        # of what is independent: no more alarms, and no fewer catches, than chance makes of that
        ((1, 4, 4), (0, 200, 200), False),
        ((1, 6, 6), (0, 200, 200), True),
        ((2, 6, 6), (0, 200, 200), False),
        ((0, 3, 4), (0, 200, 200), True),
        ((0, 2, 4), (0, 200, 200), False),
    ],
)
def test_trust_takes_what_was_drawn_and_what_chance_leaves_of_independent_runs(
    alone: tuple[int, int, int], drawn: tuple[int, int, int], trusted: bool
) -> None:
    assert SelfCheck(8, outcome(*alone), outcome(*drawn)).trusted is trusted


def test_of_no_trial_the_share_is_none() -> None:
    assert Rate(0, 0).share == 0


def test_a_self_check_needs_two_runs_of_the_same_grid(old: Rows) -> None:
    with pytest.raises(InputError, match="same finished experiments"):
        self_check([old, old[1:]])
    with pytest.raises(InputError, match="two runs or more"):
        self_check([old])
