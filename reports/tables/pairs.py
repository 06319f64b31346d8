"""Numbers of two cells that compare: scores by view and seed, ratios of means."""

from collections.abc import Sequence
from statistics import fmean

from reports.rows.schema import Cell, Row, held_out_views
from reports.tables.origins import machine_of

ANYWHERE = ("size_mb", "splats")  # the same on every machine; all else is a matter of speed


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

    Of times and speeds, where not all runs were on one machine, only seeds count that both sides
    ran on the same one; None where there is none.
    """
    if metric not in ANYWHERE and len({machine_of(row) for row in (*mine, *other)}) > 1:
        mine, other = _on_one_machine(mine, other)
    ours = [row["metrics"].get(metric) for row in mine]
    theirs = [row["metrics"].get(metric) for row in other]
    if not ours or not theirs or not all(ours) or not all(theirs):
        return None
    return fmean(ours) / fmean(theirs)


def _on_one_machine(mine: Sequence[Row], other: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    known = {int(row["seed"]): row for row in other}
    pairs = [(row, known[int(row["seed"])]) for row in mine if int(row["seed"]) in known]
    pairs = [(one, two) for one, two in pairs if machine_of(one) == machine_of(two)]
    return [one for one, _ in pairs], [two for _, two in pairs]
