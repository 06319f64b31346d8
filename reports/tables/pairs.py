"""Numbers of two cells that compare, and what may be said of them.

Numbers are scores by view and seed, and ratios of means. A gain or a loss is called one only where
the 95 % interval excludes zero. One view has no interval, so that nothing is claimed of it; what
prints as zero is called neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean, median

from reports.rows import clock, statistics
from reports.rows.columns import signed
from reports.rows.schema import Cell, Row, held_out_views
from reports.rows.statistics import Interval
from reports.tables.notes import parts_known
from reports.tables.origins import machine_of

BASE, CONTROL = "3dgs", "3dgs-tuned"
ANYWHERE = ("size_mb", "splats")  # the same on every machine; all else is a matter of speed
GAINS, LOSES, UNSURE = "gains", "loses", "does not measurably differ"
TINY, ONE_VIEW = "differs by less than 0.01 dB", "cannot be told apart by one view"
KINDS = (GAINS, LOSES, UNSURE, TINY, ONE_VIEW)  # of a difference that was measured
OTHER_SCORE, NO_VIEW = "is not measured by the same score", "has no view in common"
PREPOSITIONS = {
    GAINS: "over",
    LOSES: "against",
    UNSURE: "from",
    TINY: "from",
    ONE_VIEW: "from",
    OTHER_SCORE: "as",
    NO_VIEW: "with",
}
PRINTED_AS_ZERO = 0.005  # dB: rounded to two digits


def view_scores(cell: Cell, metric: str) -> dict[tuple[str, int], float]:
    """Return a metric of a cell's held-out views by (view, seed); views without it are left out."""
    return {
        (str(view["view"]), int(row["seed"])): float(view[metric])
        for row in cell.finished
        for view in held_out_views(row)
        if view.get(metric) is not None
    }


def ratio(cell: Cell, base: Cell, metric: str) -> float | None:
    """Return the ratio of two cells' means of a run's metric; see :func:`ratio_of`."""
    return ratio_of(cell.finished, base.finished, metric)


def ratio_of(mine: Sequence[Row], other: Sequence[Row], metric: str) -> float | None:
    """Return the ratio of the means of a run's metric; None where a run lacks it or it is 0.

    Of times and speeds only seeds count that both sides ran on one machine, as other seeds may
    have had other work beside them. Where there is none, all do, or, of several machines, None.
    """
    if metric not in ANYWHERE:
        one_machine = len({machine_of(row) for row in (*mine, *other)}) == 1
        shared = _on_one_machine(mine, other)
        if shared[0] or not one_machine:
            mine, other = shared
    ours = [row["metrics"].get(metric) for row in mine]
    theirs = [row["metrics"].get(metric) for row in other]
    if not ours or not theirs or not all(ours) or not all(theirs):
        return None
    return fmean(ours) / fmean(theirs)


def _on_one_machine(mine: Sequence[Row], other: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    by_seed = {int(row["seed"]): row for row in other}
    pairs = [(row, by_seed[int(row["seed"])]) for row in mine if int(row["seed"]) in by_seed]
    pairs = [(one, two) for one, two in pairs if machine_of(one) == machine_of(two)]
    return [one for one, _ in pairs], [two for _, two in pairs]


@dataclass(frozen=True)
class Comparison:
    """A method against ``base`` on one background; ``size`` and ``time`` (by ``clock``) are ratios.

    ``details`` is the difference in PSNR on small parts, None where nobody marked them; ``median``
    that of quality over the views, None where no view is an outlier.
    """

    background: str
    method: str
    metric: str
    quality: Interval | None
    size: float | None
    time: float | None
    details: Interval | None = None
    base: str = BASE
    median: float | None = None
    clock: str = clock.WALL


def compare(
    selected: Sequence[Cell], background: str, against: str = BASE, timer: str = clock.WALL
) -> list[Comparison]:
    """Compare every method of one capture and background with 3DGS, or the tuned one.

    ``timer`` is the metric that training times are taken from (:mod:`reports.rows.clock`).
    """
    finished = [c for c in selected if c.key.background == background and c.finished]
    base = next((c for c in finished if c.key.method == against), None)
    if base is None:
        return []
    out = []
    for cell in finished:
        if cell is base or cell.key.method == BASE:
            continue
        masked = view_scores(cell, "mask_psnr") and view_scores(base, "mask_psnr")
        metric = "mask_psnr" if masked else "psnr"
        ours, theirs = view_scores(cell, metric), view_scores(base, metric)
        interval = statistics.paired(ours, theirs)
        size, time = ratio(cell, base, "size_mb"), ratio(cell, base, timer)
        small = statistics.paired(
            view_scores(cell, "detail_psnr"), view_scores(base, "detail_psnr")
        )
        comparison = Comparison(
            background, cell.key.method, metric, interval, size, time, small, against, clock=timer
        )
        by_view = statistics.by_view(ours, theirs)
        if parts_known(cell.finished) and statistics.outliers(by_view):
            comparison = replace(comparison, median=median(by_view.values()))
        out.append(comparison)
    return out


def kind_of(quality: Interval) -> str:
    """Return what a method does: one of :data:`KINDS`."""
    if quality.samples < 2:
        return ONE_VIEW
    if not quality.excludes_zero():
        return UNSURE
    if abs(quality.mean) < PRINTED_AS_ZERO:
        return TINY
    return GAINS if quality.mean > 0 else LOSES


def quality_words(comparison: Comparison) -> str:
    """Return a verb with its number, where it was measured, and the preposition of the base."""
    where = "inside the mask" if comparison.metric == "mask_psnr" else "over the full frame"
    quality = comparison.quality
    if quality is None:
        return f"{NO_VIEW} {PREPOSITIONS[NO_VIEW]}"
    kind = kind_of(quality)
    if kind in (GAINS, LOSES):
        return f"{kind} {abs(quality.mean):.2f} dB {where} {PREPOSITIONS[kind]}"
    if kind == TINY:
        return f"{kind} {where} {PREPOSITIONS[kind]}"
    return f"{kind} {where} ({signed(quality.mean)} dB) {PREPOSITIONS[kind]}"
