"""Steps that are planted are named, and noise has none."""

import itertools
from statistics import median

import numpy as np
import pytest

from reports.history.steps import FEWEST, deviations, find_steps

NOISE = 0.02


def noisy(levels: list[tuple[int, float]], seed: int, spread: float = NOISE) -> list[float]:
    """Return so many points of each level, with normal noise."""
    rng = np.random.default_rng(seed)
    clean = [level for count, level in levels for _ in range(count)]
    return [float(value) for value in clean + rng.normal(0, spread, len(clean))]


def steps(values: list[float]) -> list[tuple[int, int]]:
    """Return (index of the first point, sign) of each step."""
    found = find_steps(values, margin=0.1, noise=0.01)
    return [(step.first, int(np.sign(step.change))) for step in found]


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(
    ("levels", "expected"),
    [
        ([(8, 24.0), (6, 24.3)], [(8, +1)]),
        ([(8, 24.0), (6, 23.7)], [(8, -1)]),
        ([(10, 24.0), (10, 23.6), (10, 24.1)], [(10, -1), (20, +1)]),
        ([(10, 24.0), (10, 23.6), (10, 23.2)], [(10, -1), (20, -1)]),
        ([(2, 24.0), (2, 23.5)], [(2, -1)]),
        ([(30, 24.0), (2, 23.7)], [(30, -1)]),
        ([(30, 24.0)], []),
    ],
)
def test_planted_steps_are_found_at_their_first_point(
    levels: list[tuple[int, float]], expected: list[tuple[int, int]], seed: int
) -> None:
    assert steps(noisy(levels, seed)) == expected


def test_levels_are_medians_before_and_after() -> None:
    (step,) = find_steps([1.0, 1.2, 1.1, 3.0, 3.3, 3.1], margin=0.5, noise=0.01)
    assert (step.first, step.before, step.after) == (3, 1.1, 3.1)


@pytest.mark.parametrize("count", [4, 6, 10, 30, 100])
def test_noise_alone_hardly_ever_shows_a_step(count: int) -> None:
    """Whatever its size: neither margin nor the least noise helps here."""
    tries = 300 if count <= 30 else 60
    hits = sum(
        bool(find_steps(noisy([(count, 0.0)], seed, 1.0), margin=1e-9, noise=1e-9))
        for seed in range(tries)
    )
    assert hits <= 0.02 * tries


def test_one_disturbed_run_is_no_step() -> None:
    assert steps([24.0, 24.01, 22.0, 24.0, 24.02, 23.99, 24.0]) == []


def test_a_step_at_the_newest_run_waits_for_a_second_one() -> None:
    before = [24.0] * 6
    assert steps([*before, 23.5]) == []
    assert steps([*before, 23.5, 23.5]) == [(6, -1)]


def test_changes_below_the_margin_are_no_steps() -> None:
    """Deterministic runs repeat to the bit, so even a tiny change fits perfectly."""
    assert steps([24.0] * 10 + [24.09] * 10) == []
    found = find_steps([24.0] * 10 + [24.09] * 10 + [24.5] * 10, margin=0.1, noise=0.01)
    assert [step.first for step in found] == [20]
    assert found[0].before == pytest.approx(24.045)


def test_a_series_that_repeats_to_the_bit_has_none() -> None:
    assert steps([24.0] * 50) == []
    assert steps([]) == []
    assert steps([24.0, 25.0]) == []


def test_the_fit_is_the_best_of_all_fits() -> None:
    """Compare the dynamic programme with every choice of two steps."""
    values = noisy([(4, 0.0), (4, 1.0), (4, 0.2)], 3, 0.05)
    cuts = itertools.combinations(range(FEWEST, len(values) - 1), 2)

    def cost(parts: tuple[int, int]) -> float:
        ends = [0, *parts, len(values)]
        levels = [values[a:b] for a, b in itertools.pairwise(ends)]
        if min(map(len, levels)) < FEWEST:
            return float("inf")
        return sum(abs(v - median(level)) for level in levels for v in level)

    best = min(cuts, key=cost)
    assert [first for first, _ in steps(values)] == list(best)


def test_deviations_are_those_from_the_median() -> None:
    values = np.random.default_rng(0).normal(0, 1, 9)
    found = deviations(values)
    for begin, end in itertools.combinations(range(len(values) + 1), 2):
        if end - begin >= FEWEST:
            part = values[begin:end]
            assert found[begin, end] == pytest.approx(np.abs(part - np.median(part)).sum())
        else:
            assert np.isinf(found[begin, end])


def test_margin_and_noise_are_more_than_nothing() -> None:
    with pytest.raises(ValueError, match="margin and noise above 0, found 0 and 1"):
        find_steps([1.0] * 5, margin=0, noise=1)
