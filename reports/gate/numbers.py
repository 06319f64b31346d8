"""One number of one cell: what is known of it on both sides, and how it changed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import fmean, median
from typing import Any

from reports.gate import speed
from reports.gate.tolerances import Tolerance
from reports.rows.schema import CellKey, Row

NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, normal distribution
MEDIAN_ERROR = NORMAL_MAD * 1.2533  # and times the median's standard error over the mean's


@dataclass(frozen=True)
class Judged:
    """What is known of one number in one cell before its interval is set."""

    key: CellKey
    tolerance: Tolerance
    pairs: Mapping[tuple[str, int], tuple[float, float]]  # (view, seed): (before, after)
    before: float
    after: float
    noise: float  # standard deviation of one run's value, see ``tolerances.py``
    moved: bool = False  # the two sides come from processors that may round differently
    errors: Mapping[int, float] = field(default_factory=dict)  # seed: stated error of its change

    @cached_property
    def changes(self) -> Mapping[tuple[str, int], float]:
        """Signed changes by view and seed, positive is better; logarithms for ratios."""
        sign = self.tolerance.direction
        if self.tolerance.kind in ("difference", "exact"):
            return {key: sign * (after - before) for key, (before, after) in self.pairs.items()}
        return {key: sign * math.log(after / before) for key, (before, after) in self.pairs.items()}

    @cached_property
    def by_seed(self) -> Mapping[int, tuple[float, float]]:
        """Each seed's change and the error of it that its own measurements show.

        Of speeds the median over repeats counts: what disturbs a machine disturbs single repeats.
        Its error is the median absolute deviation's, or what the rows state where there is one
        repeat.
        """
        changes: dict[int, list[float]] = {}
        for (_, seed), change in self.changes.items():
            changes.setdefault(seed, []).append(change)
        if self.tolerance.kind != "speed":
            return {seed: (fmean(values), 0.0) for seed, values in changes.items()}
        out = {}
        for seed, values in changes.items():
            centre = median(values)
            spread = median(abs(value - centre) for value in values)
            own = MEDIAN_ERROR * spread / math.sqrt(len(values))
            out[seed] = centre, math.hypot(own, self.errors.get(seed, 0.0))
        return out

    @cached_property
    def change(self) -> float:
        """The mean change over seeds, positive is better; a logarithm for ratios."""
        return fmean([change for change, _ in self.by_seed.values()])


def collect(
    key: CellKey, tolerance: Tolerance, pairs: Sequence[tuple[Row, Row]]
) -> tuple[Judged | None, str]:
    """Gather one number's values, or say why there is none to judge.

    Both are empty for a number that neither side has and nobody requires.
    """
    values: dict[tuple[str, int], tuple[float, float]] = {}
    errors: dict[int, float] = {}
    for after, before in pairs:
        seed = int(after["seed"])
        ours, theirs = _values(after, tolerance), _values(before, tolerance)
        if tolerance.kind == "speed":  # lap by lap, as many as both have
            stated = (speed.noise(row, tolerance.metric) for row in (after, before))
            errors[seed] = math.hypot(*stated)
            both = ours.keys() & theirs.keys()
            ours, theirs = ({k: v[k] for k in sorted(both)} for v in (ours, theirs))
        if not ours and not theirs and not tolerance.required:
            return None, ""
        problem = _unusable(tolerance, ours, theirs)
        if problem:
            return None, problem
        values |= {(name, seed): (theirs[name], ours[name]) for name in ours}
    # of lists: `fmean` counts the items of anything else one by one
    before_mean = fmean([before for before, _ in values.values()])
    after_mean = fmean([after for _, after in values.values()])
    moved = any(speed.rounds_otherwise(*pair) for pair in pairs)
    noise = _noise(tolerance, [before for _, before in pairs], moved=moved)
    return Judged(key, tolerance, values, before_mean, after_mean, noise, moved, errors), ""


def _noise(tolerance: Tolerance, baseline: Sequence[Row], *, moved: bool) -> float:
    """Return the standard deviation of one run's value where its spread cannot show it.

    Exact numbers have one between machines only: that of the baseline, where it knows one. Where
    nobody measured how many views other machines register, each view counts as a draw with the
    baseline's share (one more success and one more failure: Laplace's rule of succession).
    """
    if tolerance.kind != "exact" or not moved:
        return tolerance.noise
    if tolerance.between or tolerance.metric != "registered":
        return tolerance.between or 0.0
    registrations = [row.get("registration") or {} for row in baseline]
    views = fmean(float(one.get("views") or one["registered"]) for one in registrations)
    share = (fmean(float(one["registered"]) for one in registrations) + 1) / (views + 2)
    return math.sqrt(views * share * max(0.0, 1 - share))


def _unusable(tolerance: Tolerance, ours: Mapping[str, float], theirs: Mapping[str, float]) -> str:
    if not ours or not theirs:
        where = "candidate" if not ours else "baseline"
        return f"missing in the {where}" if ours or theirs else "missing in both"
    if ours.keys() != theirs.keys():
        return f"measured on other views: {', '.join(sorted(ours.keys() ^ theirs.keys())[:4])}"
    if not all(map(math.isfinite, [*ours.values(), *theirs.values()])):
        return "a value is not finite"
    if tolerance.kind in ("ratio", "speed"):
        for side, values in (("candidate", ours), ("baseline", theirs)):
            low = min(values.values())
            if low <= 0:
                return f"the {side} has {low:g}: expected more than 0"
    return ""


def _values(row: Row, tolerance: Tolerance) -> dict[str, float]:
    """Return one row's values of a metric by view; a single one is called ``all``."""
    if tolerance.kind == "difference":
        return {
            str(view["view"]): float(view[tolerance.metric])
            for view in row["per_view"]
            if view["split"] == "test" and view.get(tolerance.metric) is not None
        }
    if tolerance.kind == "speed":
        return speed.calibrated(row, tolerance.metric)
    value = _single(row, tolerance.metric)
    return {} if value is None else {"all": float(value)}


def _single(row: Row, metric: str) -> Any:
    if metric == "registered":
        return (row.get("registration") or {}).get("registered")
    if metric == "mean_iou":
        return (row.get("masks") or {}).get("mean_iou")
    return row["metrics"].get(metric)


def worst_view(number: Judged) -> str | None:
    """Return the view that lost most, for numbers that are measured per view."""
    if number.tolerance.kind != "difference":
        return None
    changes = number.changes
    return min(changes, key=lambda key: changes[key])[0]
