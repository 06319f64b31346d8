"""Runs of the registry as series: one per cell, metric and setup, its points in order of time.

A **point** is one sitting of a cell: its runs of one state of the code, one per seed. Its value is
their mean. Points are joined to a **series** only where they compare: the same seeds, configuration
and capture files, and for speed the same machine. So a changed setting begins another line and is
never taken for a step.

A run is a mapping as ``tasks.registry.history.runs_of`` returns it: the row's identity (capture,
background, method, seed, iterations, resolution), ``run_id``, ``when`` (seconds since 1970),
``status``, ``metrics``, ``git``, ``code_version``, ``config_digest``, ``inputs``, the machines
``timed_on`` (training) and ``measured_on`` (rendering), and ``gate``: what the gate said of its
cell, ``{"baseline": …, "verdicts": {metric: verdict}}``.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from reports.gate.findings import Verdict
from reports.gate.tolerances import TOLERANCES, Tolerance
from reports.history.steps import Step, find_steps
from reports.rows.columns import COLOUR_CORRECTED, IN_MASK, PAPER, Column
from reports.rows.schema import CellKey, key_of, order

Run = Mapping[str, Any]
MOST_POINTS = 200  # of a series, the newest: the fit takes time with the square of it
COMMIT_LETTERS = 8
# Metrics in the order of the page. Speeds that are divided by the fixed workload of their process
# are those that steps are looked for in: plain ones follow whatever else the machine did.
DIGITS = "digits"  # the kind of a column without a unit
METRICS: tuple[Column, ...] = (
    *PAPER,
    *IN_MASK,
    COLOUR_CORRECTED,
    Column("paper_l1", "L1 weighted by attention", -1, "l1"),
    Column("fps_calibrated", "FPS, calibrated", +1, DIGITS),
    Column("time_calibrated", "Time, calibrated", -1, DIGITS),
    Column("registered", "Registered views", +1, "count"),
    Column("mean_iou", "Mask IoU", +1, "ssim"),
)
CALIBRATED = {"fps_calibrated": "fps", "time_calibrated": "time"}
MACHINES = {"fps": "measured_on", "time": "timed_on"}
# Mean over standard deviation of a normal distribution's absolute deviation: √(2 / π)
MEAN_DEVIATION = math.sqrt(2 / math.pi)
OF_A_RUN = ("status", "rows", "truth")  # verdicts on a whole run, which all its metrics share
ALARMS = (Verdict.WORSE, Verdict.NEWLY_FAILING)


@dataclass(frozen=True)
class Point:
    """One sitting of a cell: its runs by seed."""

    runs: tuple[Run, ...]

    @property
    def when(self) -> float:
        """Seconds since 1970 at which the first of its runs began."""
        return float(min(run["when"] for run in self.runs))

    @property
    def commit(self) -> str:
        """The commit's first letters; of code that is in no repository the code's digest."""
        git = str(self.runs[0].get("git") or "")
        if git in ("", "None"):
            return f"code {str(self.runs[0].get('code_version') or 'unknown')[:COMMIT_LETTERS]}"
        commit, changed, _ = git.partition("+")
        return commit[:COMMIT_LETTERS] + ("+" if changed else "")

    def value(self, metric: str) -> float | None:
        """Mean over seeds; None where a seed failed or has no such number."""
        found = [run["metrics"].get(metric) for run in self.runs]
        finished = all(run["status"] == "finished" for run in self.runs)
        return fmean(found) if finished and None not in found else None

    def verdict(self, metric: str) -> tuple[str, str] | None:
        """Return what the gate said of a metric, and the baseline's name; None without a gate."""
        named = CALIBRATED.get(metric, metric)
        for run in self.runs:
            gate = run.get("gate") or {}
            verdicts = gate.get("verdicts") or {}
            said = next((verdicts[name] for name in (named, *OF_A_RUN) if verdicts.get(name)), None)
            if said:
                return str(said), str(gate.get("baseline", ""))
        return None


@dataclass(frozen=True)
class Series:
    """One metric of a cell under one setup; ``steps`` are indices into ``points``."""

    cell: CellKey
    column: Column
    points: tuple[Point, ...]
    values: tuple[float | None, ...]
    steps: tuple[Step, ...]

    def measured(self) -> list[int]:
        """Return the indices of the points that have a value."""
        return [index for index, value in enumerate(self.values) if value is not None]


@dataclass(frozen=True)
class FoundStep:
    """A step in words' parts: where, from what to what, and which commits it lies between."""

    series: Series
    step: Step

    @property
    def first(self) -> Point:
        """The first point on the new level."""
        return self.series.points[self.step.first]

    @property
    def last_before(self) -> Point:
        """The last point on the old level that has a value."""
        earlier = [index for index in self.series.measured() if index < self.step.first]
        return self.series.points[earlier[-1]]

    @property
    def better(self) -> bool | None:
        """Whether the step is a gain; None for metrics without a direction."""
        direction = direction_of(self.series.column)
        return None if direction == 0 else self.step.change * direction > 0


def tolerance_of(metric: str) -> Tolerance | None:
    """Return how the gate judges a metric; None for those that it does not judge."""
    named = CALIBRATED.get(metric, metric)
    return next((one for one in TOLERANCES if one.metric == named), None)


def direction_of(column: Column) -> int:
    """Return +1 where more is better, −1 where less is; splats are counted, fewer are better."""
    tolerance = tolerance_of(column.key)
    return column.direction or (0 if tolerance is None else tolerance.direction)


def points_of(runs: Iterable[Run]) -> list[Point]:
    """Group a cell's runs into sittings, oldest first.

    A run joins the newest sitting of its code and machine, unless that has a run of its seed.
    """
    sittings: list[list[Run]] = []
    open_ones: dict[tuple[Any, ...], list[Run]] = {}
    for run in sorted(runs, key=lambda run: (run["when"], run["seed"])):
        key = tuple(
            run.get(name) for name in ("git", "code_version", "timed_on", "inputs", "protocol")
        )
        sitting = open_ones.get(key)
        if sitting is None or any(one["seed"] == run["seed"] for one in sitting):
            sitting = open_ones[key] = []
            sittings.append(sitting)
        sitting.append(run)
    return [Point(tuple(sorted(runs, key=lambda run: run["seed"]))) for runs in sittings]


def all_series(runs: Iterable[Run]) -> list[Series]:
    """Return every series of a benchmark's runs: cells as tables order them, then metrics."""
    by_cell: dict[CellKey, list[Run]] = {}
    for run in runs:
        by_cell.setdefault(key_of(run), []).append(run)
    found = []
    for cell in sorted(by_cell, key=order):
        points = points_of(by_cell[cell])
        for column in METRICS:
            if any(point.value(column.key) is not None for point in points):
                found += list(_of_metric(cell, column, points))
    return found


def _of_metric(cell: CellKey, column: Column, points: Sequence[Point]) -> Iterator[Series]:
    setups: dict[tuple[Any, ...], list[Point]] = {}
    for point in points:
        setups.setdefault(setup_of(point, column.key), []).append(point)
    for mine in setups.values():
        newest = tuple(mine[-MOST_POINTS:])
        values = tuple(point.value(column.key) for point in newest)
        yield Series(cell, column, newest, values, tuple(steps_of(column.key, values)))


def setup_of(point: Point, metric: str) -> tuple[Any, ...]:
    """Return what points of one series share."""
    keys = ("seed", "config_digest", "inputs", "protocol")
    settings = tuple(tuple(run.get(key) for key in keys) for run in point.runs)
    machine = MACHINES.get(CALIBRATED.get(metric, metric), "")
    return settings, point.runs[0].get(machine)


def steps_of(metric: str, values: Sequence[float | None]) -> list[Step]:
    """Return the steps of a metric that the gate judges; plain speeds and others have none.

    Steps count from the gate's margin on. Ratios (speed, size) are fitted as logarithms, and told
    in the metric's own unit.
    """
    tolerance = tolerance_of(metric)
    measured = [(index, value) for index, value in enumerate(values) if value is not None]
    if tolerance is None or metric in MACHINES or not measured:
        return []
    ratio = tolerance.kind in ("ratio", "speed")
    if ratio and min(value for _, value in measured) <= 0:
        return []
    noise = MEAN_DEVIATION * tolerance.noise or 1e-3
    margin = tolerance.margin or 0.5  # counts: half a view
    fitted = [math.log(value) if ratio else value for _, value in measured]
    found = find_steps(fitted, margin=margin, noise=noise)
    back = math.exp if ratio else float
    return [Step(measured[s.first][0], back(s.before), back(s.after)) for s in found]


def found_steps(series: Iterable[Series]) -> list[FoundStep]:
    """Return all steps, the newest first."""
    found = [FoundStep(one, step) for one in series for step in one.steps]
    return sorted(found, key=lambda step: -step.first.when)
