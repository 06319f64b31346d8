"""Losses planted into a baseline's own rows: they show that the gate still detects losses.

Every run of the gate compares the baseline with itself, once with each loss of :func:`plants`. It
must name the loss; without one it must call nothing worse. Losses are uneven, as real ones are:
views lose different amounts, and so do captures, around the mean that is stated.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from reports.gate.compare import compare
from reports.gate.findings import GateReport, Sensitivity, Verdict
from reports.gate.speed import RATES
from reports.rows.comparable import trained_views
from reports.rows.schema import Row, held_out_views

EVERYWHERE, IN_ONE_PART = 0.3, 0.5  # dB; a part is a method, or a capture
GROWTH = SLOWDOWN = 0.10
# Standard deviation over mean of what single views lose. Real regressions (settings of a training
# changed on purpose) gave 0.25 to 0.41, averaged over cells; this is somewhat harder to see.
UNEVEN = 0.5  # of views within a capture, and of captures
SPEED_METRICS = ("time", "fps")
OTHER = "another"  # a digest that no file has

Rows = Sequence[Row]


@dataclass(frozen=True)
class Plant:
    """One loss: its name, how it changes rows, and whether a report names it."""

    name: str
    change: Callable[[Rows], list[Row]]
    named: Callable[[GateReport], bool]


def sensitivity(baseline: Rows, noise: Mapping[str, float] | None = None) -> Sensitivity:
    """Judge a baseline's rows against themselves, once as they are and once with each loss."""
    quiet = compare(baseline, baseline, noise=noise)
    alarms = [f"{f.cell} {f.metric}" for f in quiet.findings if f.verdict == Verdict.WORSE]
    names: dict[bool, list[str]] = {True: [], False: []}
    for plant in plants(baseline):
        report = compare(plant.change(baseline), baseline, noise=noise)
        names[plant.named(report)].append(plant.name)
    return Sensitivity(tuple(names[True]), tuple(names[False]), tuple(alarms))


def plants(baseline: Rows) -> list[Plant]:
    """Return the losses to plant, among them one for each method and each capture of the rows."""
    finished = [row for row in baseline if row["status"] == "finished"]
    methods = list(dict.fromkeys(row["method"] for row in finished))
    captures = list(dict.fromkeys(row["capture"] for row in finished))
    lose = partial(lose_quality, decibels=IN_ONE_PART)
    in_parts = [
        Plant(f"{IN_ONE_PART} dB in {name}", _each(lose, name), partial(_worse, "psnr", part=name))
        for names in (methods, captures)
        if len(names) > 1
        for name in names
    ]
    return [
        Plant(f"{EVERYWHERE} dB everywhere", lose_everywhere, partial(_worse, "psnr")),
        *in_parts,
        Plant(f"{GROWTH:.0%} larger files", _each(grow), partial(_worse, "size_mb")),
        Plant(f"{SLOWDOWN:.0%} slower training", _each(lose_speed), partial(_worse, "time")),
        Plant(f"{SLOWDOWN:.0%} slower rendering", _each(lose_speed), partial(_worse, "fps")),
        Plant("a view leaked into training", _each(leak), partial(_unlike, "were trained on")),
        Plant("masks 2 px larger", _each(other_masks), partial(_unlike, "the masks changed")),
        Plant("another truth", _each(other_truth), partial(_unlike, "the truth changed")),
    ]


def _each(change: Callable[[Row], Row], part: str | None = None) -> Callable[[Rows], list[Row]]:
    """Apply a change to every finished row, or to those of one method or capture."""

    def changed(rows: Rows) -> list[Row]:
        return [
            change(row)
            if row["status"] == "finished" and part in (None, row["method"], row["capture"])
            else row
            for row in rows
        ]

    return changed


def _worse(metric: str, report: GateReport, *, part: str | None = None) -> bool:
    """Whether a metric is called worse; with ``part`` in a cell of it, or over all cells."""
    return any(
        f.metric == metric
        and f.verdict == Verdict.WORSE
        and (part is None or "@" not in f.cell or _is_of(f.cell, part))
        for f in report.findings
    )


def _is_of(cell: str, part: str) -> bool:
    """Whether a cell, written ``rover/nobg-ours@100x64``, is of a method or capture."""
    return f"-{part}@" in cell or cell.startswith(f"{part}/")


def _unlike(words: str, report: GateReport) -> bool:
    return any(f.verdict == Verdict.NOT_COMPARABLE and words in f.reason for f in report.findings)


def lose_everywhere(rows: Rows, decibels: float = EVERYWHERE, draw: int = 0) -> list[Row]:
    """Take ``decibels`` from PSNR as the mean over captures, uneven in captures and in views."""
    captures = sorted({row["capture"] for row in rows if row["status"] == "finished"})
    shares = dict(zip(captures, _pattern(f"captures {draw}", len(captures), UNEVEN), strict=True))
    return [
        lose_quality(row, decibels * float(shares[row["capture"]]), draw=draw)
        if row["status"] == "finished"
        else row
        for row in rows
    ]


def lose_quality(
    row: Row, decibels: float = EVERYWHERE, uneven: float = UNEVEN, draw: int = 0
) -> Row:
    """Take ``decibels`` from PSNR, full frame and in mask, as the mean over held-out views.

    Views lose different amounts, gamma-distributed with a standard deviation of ``uneven`` times
    the mean: the same view the same in all rows of a capture. Another ``draw``, other views.
    """
    names = [str(view["view"]) for view in held_out_views(row)]
    pattern = decibels * _pattern(f"{row['capture']} {draw}", len(names), uneven)
    losses = dict(zip(names, pattern, strict=True))
    views = [
        view | _less(view, losses[str(view["view"])]) if view["split"] == "test" else view
        for view in row["per_view"]
    ]
    return row | {"per_view": views}


def _less(view: Row, loss: float) -> Row:
    """Return a view's scores, as far as it has them, that much lower."""
    names = [name for name in ("psnr", "mask_psnr") if view.get(name) is not None]
    return {name: view[name] - loss for name in names}


def _pattern(name: str, count: int, uneven: float) -> np.ndarray:
    """Return what each of so many views loses, mean 1 [N]; ``name`` seeds it."""
    if not uneven or count < 2:
        return np.ones(count)
    shape = uneven**-2  # of a gamma distribution with this coefficient of variation
    rng = np.random.default_rng(list(name.encode()))
    drawn = rng.gamma(shape, 1 / shape, count)
    return np.asarray(drawn / drawn.mean())


def lose_speed(row: Row, share: float = SLOWDOWN) -> Row:
    """Make training and rendering slower, the calibration workload as fast as before."""
    metrics, repeats = dict(row["metrics"]), dict(row.get("repeats") or {})
    for metric in SPEED_METRICS:
        factor = 1 / (1 + share) if metric in RATES else 1 + share
        for name in (metric, f"{metric}_calibrated"):
            if metrics.get(name) is not None:
                metrics[name] *= factor
        if metric in repeats:
            repeats[metric] = [one | {"value": one["value"] * factor} for one in repeats[metric]]
    return row | {"metrics": metrics} | ({"repeats": repeats} if repeats else {})


def grow(row: Row, share: float = GROWTH) -> Row:
    """Make the PLY larger, and the number of splats with it."""
    metrics = dict(row["metrics"])
    for metric in ("size_mb", "splats"):
        if metrics.get(metric) is not None:
            metrics[metric] *= 1 + share
    return row | {"metrics": metrics}


def leak(row: Row) -> Row:
    """Have the first held-out view among the training views."""
    leaked = [str(view["view"]) for view in held_out_views(row)[:1]]
    trained, _ = trained_views(row)
    return row | {"trained_on": sorted({*leaked, *trained})}


def other_masks(row: Row) -> Row:
    """Have masks of other pixels, and with them another truth; what 2 px more do to digests."""
    names = ("agree", "masks") if "agree" in (row.get("digests") or {}) else ("segment", "masks")
    return _with_digests(row, *names)


def other_truth(row: Row) -> Row:
    """Have held-out views that look otherwise."""
    return _with_digests(row, "prepare", "truth")


def _with_digests(row: Row, *names: str) -> Row:
    return row | {"digests": (row.get("digests") or {}) | dict.fromkeys(names, OTHER)}
