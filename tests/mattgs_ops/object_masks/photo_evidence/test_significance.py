"""A few views show surely what chance would hardly let them show."""

import numpy as np
import pytest

from mattgs_ops.object_masks.photo_evidence.significance import (
    CHANCE,
    lowest_expected,
    surely_larger,
)


def test_one_view_in_doubt_does_not_decide_for_all() -> None:
    shares = [0.90, 0.92, 0.91, 0.89, 0.93]
    higher = [share + 0.05 + 0.001 * k for k, share in enumerate(shares)]
    assert surely_larger(higher, shares)
    assert not surely_larger(shares, higher)
    assert not surely_larger([0.99, *shares[1:]], shares)
    assert not surely_larger(shares, shares)
    assert surely_larger([1.0, 1.0], [0.5, 0.5])
    assert not surely_larger([0.9], [0.1])


def test_both_are_what_scipys_paired_test_and_quantiles_say() -> None:
    from scipy.stats import t, ttest_rel

    rng = np.random.default_rng(3)
    decided = []
    for views in rng.integers(2, 30, 300):
        first, second = rng.normal(0.3, 1, views), rng.normal(0, 1, views)
        decided.append(surely_larger(first.tolist(), second.tolist()))
        assert decided[-1] == (ttest_rel(first, second, alternative="greater").pvalue < CHANCE)
        half = t.ppf(1 - CHANCE / 4, views - 1) * first.std(ddof=1) * np.sqrt(1 + 1 / views)
        assert lowest_expected(first.tolist(), 4) == pytest.approx(first.mean() - half, rel=1e-9)
    assert 0.05 < np.mean(decided) < 0.5


@pytest.mark.parametrize("more", [1, 6])
def test_further_numbers_like_these_lie_above_but_once_in_forty_times(more: int) -> None:
    rng = np.random.default_rng(0)
    tries, below = 4000, 0
    for numbers in rng.normal(3.0, 0.5, (tries, 8 + more)):
        below += int(numbers[8:].min() < lowest_expected(list(numbers[:8]), more))
    # Bonferroni's bound is a little too careful for several
    assert 0.6 * CHANCE < below / tries < 1.25 * CHANCE


def test_numbers_that_do_not_spread_bound_themselves() -> None:
    assert lowest_expected([0.5, 0.5, 0.5], 3) == pytest.approx(0.5)


@pytest.mark.parametrize(("numbers", "more"), [([], 2), ([0.7], 2), ([0.7, 0.8], 0)])
def test_where_nothing_is_known_anything_is_expected(numbers: list[float], more: int) -> None:
    assert lowest_expected(numbers, more) == -np.inf
