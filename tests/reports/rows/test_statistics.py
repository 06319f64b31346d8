"""Intervals against their definitions and against simulation."""

import numpy as np
import pytest
from scipy import stats

from reports.rows import statistics


def test_one_seed_is_students_interval_over_views() -> None:
    values = np.array([0.1, 0.4, -0.2, 0.3, 0.25])
    found = statistics.crossed(values[:, None])
    low, high = stats.t.interval(0.95, 4, values.mean(), stats.sem(values))
    assert (found.low, found.high) == pytest.approx((low, high), rel=1e-12)


@pytest.mark.parametrize("seeds_matter", [True, False])
def test_views_and_seeds_are_crossed_random_factors(seeds_matter: bool) -> None:
    """The two-way analysis of variance of textbooks, its sums of squares entry by entry."""
    rng = np.random.default_rng(7)
    table = rng.normal(0, 1, (5, 1)) + rng.normal(0, 0.4, (5, 3))
    table += [-1.0, 0.3, 1.6] if seeds_matter else -table.mean(axis=0)
    views, seeds = table.shape
    grand = table.mean()
    of_views = [row.mean() for row in table]
    of_seeds = [column.mean() for column in table.T]
    free = (views - 1) * (seeds - 1)
    view = seeds * sum((mean - grand) ** 2 for mean in of_views) / (views - 1)
    seed = views * sum((mean - grand) ** 2 for mean in of_seeds) / (seeds - 1)
    rest = (
        sum(
            (table[v, s] - of_views[v] - of_seeds[s] + grand) ** 2
            for v in range(views)
            for s in range(seeds)
        )
        / free
    )
    # seeds that differ by less than the rest does add no negative variance: views' is left
    total = view + seed - rest if seeds_matter else view
    freedom = total**2 / (view**2 / (views - 1) + seed**2 / (seeds - 1) + rest**2 / free)
    half = stats.t.ppf(0.95, freedom) * np.sqrt(total / table.size)
    found = statistics.crossed(table, 0.9)
    expected = (grand, grand - half, grand + half, 15)
    assert (found.mean, found.low, found.high, found.samples) == pytest.approx(expected, rel=1e-9)


def test_views_whose_seeds_contradict_each_other_prove_nothing() -> None:
    """Every view and every seed has the mean 0.5, so that all that varies is what is left."""
    found = statistics.crossed(np.array([[1.5, -0.5], [-0.5, 1.5]]))
    half = float(stats.t.ppf(0.975, 1))  # its mean square is 4, of four entries
    assert (found.low, found.high) == pytest.approx((0.5 - half, 0.5 + half))


@pytest.mark.parametrize(
    ("low", "high", "beyond"),
    [(0.1, 0.3, True), (-0.3, -0.1, True), (0.0, 0.3, False), (-0.3, 0.0, False), (-1, 1, False)],
)
def test_a_sign_is_beyond_doubt_where_the_whole_interval_has_it(
    low: float, high: float, beyond: bool
) -> None:
    assert statistics.Interval((low + high) / 2, low, high, 6).excludes_zero() == beyond


def test_pairing_cancels_what_views_have_in_common() -> None:
    rng = np.random.default_rng(0)
    base = {(f"v{i}", 0): float(rng.normal(25, 5)) for i in range(6)}
    moved = {key: value - 0.3 for key, value in base.items()}
    found = statistics.paired(moved, base)
    assert found is not None
    assert found.mean == pytest.approx(-0.3)
    assert found.half == pytest.approx(0, abs=1e-9)
    assert found.excludes_zero()


def test_only_shared_and_complete_views_are_paired() -> None:
    base = {("a", 0): 1.0, ("a", 1): 1.0, ("b", 0): 1.0, ("c", 0): 1.0, ("c", 1): 1.0}
    other = {("a", 0): 2.0, ("a", 1): 2.0, ("b", 0): 9.0, ("c", 0): 2.0, ("c", 1): 2.0}
    found = statistics.paired(other, base)
    assert found is not None
    assert (found.mean, found.samples) == (1.0, 2), "views; their seeds are no further ones"
    assert statistics.paired({("x", 0): 1.0}, base) is None


def test_seeds_of_one_view_say_nothing_of_other_views() -> None:
    base = {("a", seed): 25.0 for seed in range(3)}
    found = statistics.paired({key: 25.5 + 0.01 * key[1] for key in base}, base)
    assert found is not None
    assert found.mean == pytest.approx(0.51)
    assert (found.samples, found.half) == (1, np.inf)


def test_one_value_says_nothing_of_spread() -> None:
    found = statistics.sample([0.5])
    assert (found.low, found.high) == (-np.inf, np.inf)
    assert not found.excludes_zero()


def test_two_values_have_an_interval_of_one_freedom() -> None:
    student = float(stats.t.ppf(0.975, 1))
    for found in (statistics.sample([0.1, 0.3]), statistics.stratified([[0.1, 0.3]])):
        half = student * 0.1  # their deviation, 0.2 / √2, over √2
        assert (found.low, found.high) == pytest.approx((0.2 - half, 0.2 + half))
    found = statistics.stratified([[1.0, 1.2], [5.0]])
    assert found.half == pytest.approx(student * np.sqrt((0.1**2 + 0.1**2) / 3))


@pytest.mark.parametrize(("views", "seeds"), [(6, 1), (6, 3), (12, 5)])
def test_intervals_cover_at_least_as_often_as_they_say(views: int, seeds: int) -> None:
    rng = np.random.default_rng([views, seeds])
    trials, hits = 600, 0
    for _ in range(trials):
        table = rng.normal(0, 0.1, (views, seeds)) + rng.normal(0, 0.1, (views, 1))
        if seeds > 1:
            table += rng.normal(0, 0.05, (1, seeds))
        interval = statistics.crossed(table, 0.95)
        hits += interval.low <= 0 <= interval.high
    assert hits / trials > 0.93


def test_what_strata_differ_by_is_no_noise() -> None:
    found = statistics.stratified([[1.0, 1.2, 0.8], [5.0, 5.2, 4.8]], 0.95)
    assert found.mean == pytest.approx(3)
    assert found.samples == 6
    assert found.half == pytest.approx(2.776445 * 0.2 / np.sqrt(6), rel=1e-5), "t with 4 freedoms"
    uneven = [0.0, 0.0, 3.0, 0.5]
    alone = statistics.stratified([uneven], 0.95)
    assert alone.half == pytest.approx(statistics.sample(uneven, 0.95).half)
    assert statistics.stratified([[1.0], [2.0]]).half == np.inf


def test_stratified_intervals_cover_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    offsets, trials = np.array([-1.0, 0.0, 1.0]), 1000
    hits = 0
    for _ in range(trials):
        found = statistics.stratified(list(rng.normal(0, 0.3, (3, 6)) + offsets[:, None]), 0.95)
        hits += found.low <= 0 <= found.high
    assert 0.93 < hits / trials < 0.97


def test_one_value_far_from_the_others_is_an_outlier() -> None:
    values = {"a": 0.1, "b": 0.2, "c": 0.15, "d": 0.18, "e": 0.12, "f": 8.3}
    assert statistics.outliers(values) == ["f"]
    assert statistics.outliers({name: v for name, v in values.items() if name != "f"}) == []
    # the score of 3.5 by hand: median 0, median deviation 1
    about = {str(v): float(v) for v in (-1, 0, 1, -1, 1)} | {"near": 5.1, "left": -1.0}
    assert statistics.outliers(about) == []
    assert statistics.outliers(about | {"near": 5.3}) == ["near"]


def test_where_most_are_equal_the_mean_deviation_is_the_scale() -> None:
    equal = {str(k): 1.0 for k in range(9)}
    assert statistics.outliers(equal) == []
    assert statistics.outliers(equal | {"one": 1.5}) == ["one"]
    four = {"a": 1.0, "b": 1.1, "c": 1.05, "d": 9.0}
    assert statistics.outliers(four) == [], "too few to say"
    assert statistics.outliers(four | {"e": 1.02}) == ["d"]


@pytest.mark.parametrize(("count", "found"), [(8, []), (9, ["x", "y"])])
def test_two_values_of_few_stretch_the_scale_that_they_are_measured_by(
    count: int, found: list[str]
) -> None:
    """By mean deviation they are 1 / (1.2533 × 2 / count) away, beyond 3.5 from nine values on."""
    equal = {str(k): 1.0 for k in range(count - 2)}
    assert statistics.outliers(equal | {"x": 2.0, "y": 2.0}) == found


def test_differences_by_view_are_means_over_shared_seeds() -> None:
    candidate = {("a", 0): 2.0, ("a", 1): 2.0, ("a", 2): 5.0, ("b", 0): 1.0, ("c", 0): 9.0}
    baseline = {("a", 0): 1.0, ("a", 1): 1.0, ("a", 2): 1.0, ("b", 0): 1.5}
    assert statistics.by_view(candidate, baseline) == {"a": 2.0, "b": -0.5}
