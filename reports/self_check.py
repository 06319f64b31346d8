"""The gate tried on itself: how often unchanged code alarms it, how often a planted loss escapes.

Two runs of the same code are resampled into many A/A comparisons: per cell a coin decides which run
is called the baseline, and held-out views are drawn with replacement. Nothing changed, so whatever
is called worse is a false alarm. The same comparisons with a loss planted into the candidate show
what the gate catches.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from mattgs_ops.errors import InputError
from reports.gate import GateReport, Verdict, compare
from reports.rows import Row, key_of, refused
from reports.speed import RATES

DECIBELS = 0.3
SLOWDOWN = 0.10
GROWTH = 0.10
LEAST = 200  # comparisons from which a rate of 1 % is worth stating
SPEED_METRICS = ("time", "fps")


@dataclass(frozen=True)
class SelfCheck:
    """Shares of comparisons: ``false_alarms`` without a change, the others with one planted."""

    comparisons: int
    false_alarms: float
    caught_quality: float
    caught_speed: float
    caught_size: float

    @property
    def trusted(self) -> bool:
        """Whether the gate may be trusted on such rows: under 1 % false, at least 95 % caught."""
        caught = min(self.caught_quality, self.caught_speed, self.caught_size)
        return self.false_alarms < 0.01 and caught >= 0.95


def self_check(
    first: Sequence[Row], second: Sequence[Row], *, comparisons: int = LEAST, seed: int = 0
) -> SelfCheck:
    """Judge the gate by two runs of the same code; raises :class:`InputError` for unlike runs."""
    pairs = _pairs(first, second)
    rng = np.random.default_rng(seed)
    drawn = [resample(pairs, rng) for _ in range(comparisons)]

    def rate(alarmed: Callable[[GateReport], bool], plant: Callable[[Row], Row]) -> float:
        return float(
            np.mean([alarmed(compare([plant(row) for row in new], old)) for new, old in drawn])
        )

    return SelfCheck(
        comparisons,
        rate(_worse(None), lambda row: row),
        rate(_worse("quality"), lose_quality),
        rate(_worse("cost"), lose_speed),
        rate(_worse("size"), grow),
    )


def _pairs(first: Sequence[Row], second: Sequence[Row]) -> list[tuple[Row, Row]]:
    names = [
        {(key_of(row), row["seed"]): row for row in refused(rows) if row["status"] == "finished"}
        for rows in (first, second)
    ]
    if not names[0] or names[0].keys() != names[1].keys():
        raise InputError("self-check: expected two runs with the same finished experiments")
    return [(row, names[1][key]) for key, row in names[0].items()]


def resample(
    pairs: Sequence[tuple[Row, Row]], rng: np.random.Generator
) -> tuple[list[Row], list[Row]]:
    """Return (candidate, baseline) of one A/A comparison."""
    draws: dict[object, tuple[bool, list[int]]] = {}
    candidate, baseline = [], []
    for one, other in pairs:
        held_out = [view for view in one["per_view"] if view["split"] == "test"]
        cell = key_of(one)
        if cell not in draws:  # all seeds of a cell share the coin and the views
            drawn = rng.choice(len(held_out), len(held_out)).tolist() if held_out else []
            draws[cell] = bool(rng.integers(2)), drawn
        swap, places = draws[cell]
        new, old = (other, one) if swap else (one, other)
        candidate.append(_drawn(new, places))
        baseline.append(_drawn(old, places))
    return candidate, baseline


def _drawn(row: Row, places: Sequence[int]) -> Row:
    held_out = sorted(
        (view for view in row["per_view"] if view["split"] == "test"),
        key=lambda view: str(view["view"]),
    )
    views = [held_out[p] | {"view": f"{i:03d} {held_out[p]['view']}"} for i, p in enumerate(places)]
    return row | {"per_view": views}


def _worse(aspect: str | None) -> Callable[[GateReport], bool]:
    def alarmed(report: GateReport) -> bool:
        return any(
            finding.verdict == Verdict.WORSE and aspect in (None, finding.aspect)
            for finding in report.findings
        )

    return alarmed


def lose_quality(row: Row, decibels: float = DECIBELS) -> Row:
    """Plant a loss into every held-out view's PSNR, full frame and in mask."""
    views = [
        view
        | {
            name: view[name] - decibels
            for name in ("psnr", "mask_psnr")
            if view.get(name) is not None
        }
        for view in row["per_view"]
    ]
    return row | {"per_view": views}


def lose_speed(row: Row, share: float = SLOWDOWN) -> Row:
    """Make training and rendering slower, the calibration workload as fast as before."""
    out = deepcopy(row)
    for metric in SPEED_METRICS:
        factor = 1 / (1 + share) if metric in RATES else 1 + share
        for name in (metric, f"{metric}_calibrated"):
            if out["metrics"].get(name) is not None:
                out["metrics"][name] *= factor
        for repeat in (out.get("repeats") or {}).get(metric, []):
            repeat["value"] *= factor
    return out


def grow(row: Row, share: float = GROWTH) -> Row:
    """Make the PLY larger, and the number of splats with it."""
    metrics = dict(row["metrics"])
    for metric in ("size_mb", "splats"):
        if metrics.get(metric) is not None:
            metrics[metric] *= 1 + share
    return row | {"metrics": metrics}
