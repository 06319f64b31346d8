"""The gate's intervals, each against its definition worked out beside it."""

import math
from collections.abc import Mapping
from dataclasses import replace

import pytest
from scipy import stats

from reports.gate.intervals import (
    as_share,
    interval_of,
    interval_of_all,
    rounding_noise,
    spread_among,
)
from reports.gate.numbers import Judged
from reports.gate.tolerances import TOLERANCES
from reports.rows import statistics
from reports.rows.schema import CellKey
from reports.rows.statistics import Interval

LEVEL = 0.98
ONE_SIDED = 0.99
NORMAL = float(stats.norm.ppf(ONE_SIDED))
HALVED = float(stats.norm.ppf(0.995))  # at half of the chance of error, where two intervals compete
TABLE = {t.metric: t for t in TOLERANCES}
Changes = Mapping[tuple[str, int], float]


def number(
    metric: str,
    changes: Changes,
    cell: str = "rover nobg ours",
    *,
    between: float | None = None,
    moved: bool = False,
    errors: Mapping[int, float] | None = None,
) -> Judged:
    """Return a number that was 1 and is better by ``changes``, for ratios their logarithms."""
    tolerance = replace(TABLE[metric], between=between)
    sign, plain = tolerance.direction, tolerance.kind in ("difference", "exact")
    pairs = {
        key: (1.0, 1.0 + sign * change if plain else math.exp(sign * change))
        for key, change in changes.items()
    }
    capture, background, method = cell.split()
    key = CellKey(capture, background, method, 1000, 320)
    return Judged(key, tolerance, pairs, 1.0, 1.0, tolerance.noise, moved, errors or {})


def views(*changes: float, seed: int = 0) -> dict[tuple[str, int], float]:
    return {(f"v{place}", seed): change for place, change in enumerate(changes)}


def ends(interval: Interval) -> tuple[float, float, float]:
    return interval.low, interval.mean, interval.high


def about(mean: float, half: float) -> object:
    return pytest.approx((mean - half, mean, mean + half), rel=1e-7)


def test_exact_numbers_have_the_noise_between_machines_alone() -> None:
    seeds = {("all", seed): change for seed, change in enumerate((0.01, 0.03, 0.02))}
    one = replace(number("mean_iou", seeds), noise=0.006)
    assert ends(interval_of(one, LEVEL)) == about(0.02, NORMAL * 0.006 * math.sqrt(2 / 3))
    assert ends(interval_of(replace(one, noise=0.0), LEVEL)) == about(0.02, 0)
    assert interval_of(one, LEVEL).samples == 3


def test_runs_add_their_noise_to_the_spread_of_views() -> None:
    changes = views(0.1, 0.4, -0.1, 0.2) | views(0.2, 0.3, 0.0, 0.2, seed=1)
    changes |= views(0.0, 0.5, 0.1, 0.3, seed=2)
    one = number("psnr", changes)
    alone = statistics.paired(changes, dict.fromkeys(changes, 0.0), LEVEL)
    assert alone is not None
    run = NORMAL * one.noise * math.sqrt(2 / 3)
    assert ends(interval_of(one, LEVEL)) == about(alone.mean, math.hypot(alone.half, run))
    # what six cells differ by counts where it is more
    others = float(stats.t.ppf(ONE_SIDED, 6 - 1)) * 0.3
    wide = math.hypot(alone.half, others)
    assert ends(interval_of(one, LEVEL, 0.3, 6)) == about(alone.mean, wide)
    narrow = math.hypot(alone.half, run)
    assert ends(interval_of(one, LEVEL, 0.001, 6)) == about(alone.mean, narrow)


def test_of_speeds_laps_show_the_error_and_rows_state_one() -> None:
    laps = {(str(lap), 0): change for lap, change in enumerate((0.1, 0.12, 0.15, 0.1, 0.2))}
    laps |= {(str(lap), 1): 0.3 for lap in range(3)}
    one = number("time", laps, errors={0: 0.01, 1: 0.02})
    deviation = 0.02  # the median of the first seed's deviations from its median, 0.12
    # of a normal sample: standard over median absolute deviation, error of median over mean
    own = 1.4826 * 1.2533 * deviation / math.sqrt(5)
    first, second = math.hypot(own, 0.01), 0.02  # the second seed's laps agree
    stated, measured = one.noise * math.sqrt(2 / 2), math.hypot(first, second) / 2
    half = NORMAL * math.hypot(stated, measured)
    expected = [math.expm1(0.21 + part) for part in (-half, 0, half)]
    assert ends(interval_of(one, LEVEL)) == pytest.approx(expected, rel=1e-7)


def test_rounding_has_noise_in_the_runs_that_it_moved() -> None:
    one = number("psnr", views(0.1, 0.1) | views(0.2, 0.2, seed=1), between=0.05)
    other = number("psnr", views(0.0, 0.0) | views(-0.1, 0.1001, seed=1), between=0.05)
    moved, runs = 3, 4
    assert rounding_noise([one, other]) == pytest.approx(0.05 * math.sqrt(2 * moved) / runs)
    assert rounding_noise([number("psnr", views(0.1))]) is None
    assert rounding_noise([number("psnr", views(0.1), between=0.0)]) is None
    assert rounding_noise([number("time", {("0", 0): 0.1}, between=0.05)]) is None


@pytest.mark.parametrize(
    ("moved", "cells", "by_noise"), [(True, 3, True), (True, 4, False), (False, 1, False)]
)
def test_where_few_cells_moved_machines_noise_takes_the_place_of_spread(
    moved: bool, cells: int, by_noise: bool
) -> None:
    one = number("psnr", views(0.3, 0.3, 0.3), between=0.2, moved=moved)
    half = HALVED * (0.2 * math.sqrt(2) if by_noise else one.noise * math.sqrt(2))
    assert ends(interval_of(one, LEVEL, 0.0, cells)) == about(0.3, half)


def test_the_narrower_of_spread_and_noise_counts() -> None:
    jumps = number("psnr", views(-2.0, 2.6, 0.3), between=0.05)
    assert ends(interval_of(jumps, LEVEL)) == about(0.3, HALVED * 0.05 * math.sqrt(2))
    same = number("psnr", views(0.0, 0.0, 0.0), between=0.05, moved=True)
    assert ends(interval_of(same, LEVEL)) == (0, 0, 0), "to the bit"
    unstated = number("psnr", views(0.0, 0.0, 0.0))
    assert ends(interval_of(unstated, LEVEL)) == (0, 0, 0), "whatever noise the table states"
    assert ends(interval_of_all([unstated] * 3, LEVEL)) == (0, 0, 0)


def test_spread_among_cells_is_what_one_explanation_leaves() -> None:
    cells = [
        f"{capture} {background} {method}"
        for capture in ("rover", "hexapod")
        for background in ("original", "nobg")
        for method in ("3dgs", "ours")
    ]

    def of(*changes: float) -> float:
        given = zip(cells, changes, strict=False)
        return spread_among([number("psnr", views(change), cell) for cell, change in given])

    assert of(0.1, 0.2, 0.3) == 0
    assert of(0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0) == pytest.approx(0), "all of a method"
    assert of(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0) == pytest.approx(0), "of a background"
    assert of(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0) == pytest.approx(0), "of a capture"
    assert of(0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5) == pytest.approx(0), "of all"
    assert of(0.1, 0.2, 0.1, 0.2, 0.1, 0.2, 0.1, 9.0) == pytest.approx(0), (
        "one does not hide itself"
    )
    # backgrounds leave least, 0.05 each about two medians, which took two of four freedoms
    assert of(0.0, 0.1, 0.2, 0.3) == pytest.approx(1.4826 * math.sqrt(4 / 2) * 0.05)


def test_as_many_groups_as_cells_but_one_leave_one_freedom() -> None:
    cells = {"a nobg one": 0.0, "a nobg two": 0.1, "b nobg one": 1.0, "c nobg one": 5.0}
    numbers = [number("psnr", views(change), cell) for cell, change in cells.items()]
    # captures leave 0.05 in two cells of four, and their medians took three of four freedoms
    assert spread_among(numbers) == pytest.approx(1.4826 * math.sqrt(4 / 1) * 0.025)


def test_over_all_cells_captures_are_strata_of_views() -> None:
    three = [
        number("psnr", views(0.1, 0.3, 0.2) | views(0.3, 0.1, 0.4, seed=1)),
        number("psnr", views(0.3, 0.5, 0.2), "rover nobg 3dgs"),
        number("psnr", views(1.1, 1.0, 1.4), "hexapod nobg ours"),
    ]
    strata = [[(0.1 + 0.3 + 0.3) / 3, (0.3 + 0.1 + 0.5) / 3, 0.8 / 3], [1.1, 1.0, 1.4]]
    alone = statistics.stratified(strata, LEVEL)
    stated = NORMAL * TABLE["psnr"].noise * math.sqrt(2 / 4)  # of four runs
    found = interval_of_all(three, LEVEL)
    assert ends(found) == about(alone.mean, math.hypot(alone.half, stated))
    four = [*three, number("psnr", views(2.9, 3.0, 3.1), "hexapod nobg 3dgs")]
    alone = statistics.stratified([strata[0], [2.0, 2.0, 2.25]], LEVEL)
    spread = float(stats.t.ppf(0.99, 3)) * spread_among(four) / math.sqrt(4)
    assert spread > 1
    assert ends(interval_of_all(four, LEVEL)) == about(alone.mean, math.hypot(alone.half, spread))


@pytest.mark.parametrize(
    ("moved", "by_noise"),
    [
        ((True, True, True), True),
        ((True, False, False), True),
        ((False, False, False), False),
        ((True, True, True, True), False),
    ],
)
def test_over_few_cells_too_machines_noise_takes_the_place_of_spread(
    moved: tuple[bool, ...], by_noise: bool
) -> None:
    cells = [number("psnr", views(0.3, 0.3), between=0.2, moved=one) for one in moved]
    noise = 0.2 if by_noise else TABLE["psnr"].noise
    half = HALVED * noise * math.sqrt(2 / len(cells))
    assert ends(interval_of_all(cells, LEVEL)) == about(0.3, half)


@pytest.mark.parametrize("noisy", [True, False])
def test_over_all_cells_speeds_share_a_noise_that_no_number_of_cells_averages_out(
    noisy: bool,
) -> None:
    runs = [0.3, 0.1, 0.2, 0.4] if noisy else [0.25] * 4
    cells = [number("fps", {("0", seed): change}) for seed, change in enumerate(runs)]
    tolerance = TABLE["fps"]
    own = statistics.sample(runs, LEVEL).half if noisy else NORMAL * 0.02 * math.sqrt(2 / 4)
    half = math.hypot(own, NORMAL * tolerance.common * math.sqrt(2))
    expected = [math.expm1(0.25 + part) for part in (-half, 0, half)]
    assert ends(interval_of_all(cells, LEVEL)) == pytest.approx(expected, rel=1e-7)


def test_a_logarithm_is_read_as_a_share() -> None:
    found = as_share(Interval(math.log(1.1), math.log(0.9), math.inf, 4))
    assert ends(found) == pytest.approx((-0.1, 0.1, math.inf))
    assert as_share(Interval(0.0, -math.inf, 0.0, 4)).low == -1
