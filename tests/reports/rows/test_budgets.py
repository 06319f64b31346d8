"""Bjøntegaard's differences: known curves, what is compared, what is left out."""

from collections.abc import Callable
from math import log
from typing import Any

import numpy as np
import pytest

from reports.rows import budgets
from reports.rows.budgets import Gap, front, gap, mean_cost, mean_quality

Row = dict[str, Any]
BASE = [(size, 20 + 3 * np.log2(size)) for size in (1.0, 2.0, 4.0, 8.0)]


def test_a_curve_shifted_in_quality_gains_that_everywhere() -> None:
    found = gap([(size, quality + 0.6) for size, quality in BASE], BASE)
    assert found.quality == pytest.approx(0.6)
    # 3 dB a doubling: 0.6 dB are a fifth of one
    assert found.cost == pytest.approx(-log(2) / 5)


def test_half_the_size_for_the_same_quality_is_minus_fifty_percent() -> None:
    found = gap([(size / 2, quality) for size, quality in BASE], BASE)
    assert found.cost == pytest.approx(log(0.5))
    interval = mean_cost([found, found])
    assert interval is not None
    assert interval.mean == pytest.approx(-50)
    assert found.quality == pytest.approx(3)


def test_it_is_the_area_between_curves_of_any_shape() -> None:
    rng = np.random.default_rng(4)
    sizes = np.cumsum(rng.uniform(0.5, 2, 6))
    one = list(zip(sizes, 20 + np.cumsum(rng.uniform(0.1, 1, 6)), strict=True))
    other = list(zip(sizes, 20 + np.cumsum(rng.uniform(0.1, 1, 6)), strict=True))
    # on the shared nodes' logarithm, by Simpson's rule on a fine grid of scipy's own PCHIP
    from scipy.integrate import simpson
    from scipy.interpolate import PchipInterpolator

    grid = np.linspace(np.log(sizes[0]), np.log(sizes[-1]), 20_001)
    curves = [
        PchipInterpolator(np.log(sizes), [q for _, q in points])(grid) for points in (one, other)
    ]
    expected = simpson(curves[0] - curves[1], x=grid) / (grid[-1] - grid[0])
    assert gap(one, other).quality == pytest.approx(expected, abs=1e-6)


def test_points_that_bring_nothing_are_on_no_curve() -> None:
    assert front([(4, 22.0), (1, 20.0), (2, 19.0), (3, 21.0), (5, 22.0)]) == [
        (1, 20.0),
        (3, 21.0),
        (4, 22.0),
    ]
    assert front([(1, 20.0), (1, 21.0)]) == [(1, 21.0)]


def test_curves_that_share_too_little_are_not_compared() -> None:
    far = [(size, quality + 20) for size, quality in BASE]
    assert gap(far, BASE).cost is None
    assert gap(far, BASE).quality == pytest.approx(20)
    assert gap([(100 * size, quality) for size, quality in BASE], BASE).quality is None
    assert gap(BASE, BASE[:1]) == Gap(None, None)
    assert mean_cost([Gap(None, None)]) is None


def test_a_single_point_is_as_far_as_it_lies_from_the_curve() -> None:
    point = gap([(4.0, 27.0)], BASE)
    assert point.quality == pytest.approx(1.0)
    assert point.cost == pytest.approx(-log(2) / 3)
    assert gap([(40.0, 23.0)], BASE).quality is None
    assert gap([(4.0, 10.0)], BASE).cost is None


def test_intervals_are_over_captures() -> None:
    interval = mean_quality([Gap(0.0, 0.4), Gap(0.0, 0.6), Gap(None, None)])
    assert interval is not None
    assert interval.mean == pytest.approx(0.5)
    assert interval.samples == 2
    assert interval.low < 0 < interval.high


def grid(
    make_row: Callable[..., Row], captures: tuple[str, ...] = ("rover", "hexapod")
) -> list[Row]:
    """Rows of three methods: one gains 0.5 dB in mask at any size, one cannot be limited."""
    rows = []
    for capture in captures:
        for method, gain, sizes in (
            ("3dgs", 0.0, (5000, 10_000, 20_000)),
            ("ours+", 0.5, (5000, 10_000, 20_000)),
            ("peer", -1.0, (None,)),
        ):
            for budget in sizes:
                row = make_row(capture, "nobg", method)
                count = budget or 12_000
                row["metrics"] |= {
                    "size_mb": count * 248 / 1e6,
                    "time": count / 1000,
                    "mask_psnr": 24 + np.log2(count / 5000) + gain,
                }
                rows.append(row if budget is None else row | {"budget": budget})
    return rows


def test_rows_are_grouped_into_one_curve_a_method(make_row: Callable[..., Row]) -> None:
    rows = grid(make_row)
    assert budgets.has_budgets(rows)
    found = budgets.curves(rows, "size_mb", "mask_psnr")
    assert set(found) == {("rover", "nobg"), ("hexapod", "nobg")}
    assert [len(points) for points in found["rover", "nobg"].values()] == [3, 3, 1]
    gaps = budgets.gaps(rows, "size_mb", "mask_psnr")
    assert gaps["rover", "nobg", "ours+"].quality == pytest.approx(0.5)
    # one point, between the second and the third of 3DGS, a decibel under the curve
    assert gaps["rover", "nobg", "peer"].quality == pytest.approx(-1, abs=0.05)


def test_one_point_stands_for_a_condition_by_its_largest_budget(
    make_row: Callable[..., Row],
) -> None:
    rows = grid(make_row, ("rover",))
    kept = [(row["method"], row.get("budget")) for row in budgets.largest(rows)]
    assert kept == [("3dgs", 20_000), ("ours+", 20_000), ("peer", None)]
    assert not budgets.has_budgets(budgets.largest(rows))
