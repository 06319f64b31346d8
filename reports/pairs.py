"""Numbers of two cells that compare: scores by view and seed, ratios of means."""

from statistics import fmean

from reports.rows import Cell, held_out_views


def view_scores(cell: Cell, metric: str) -> dict[tuple[str, int], float]:
    """Return a metric of a cell's held-out views by (view, seed); views without it are left out."""
    return {
        (str(view["view"]), int(row["seed"])): float(view[metric])
        for row in cell.finished
        for view in held_out_views(row)
        if view.get(metric) is not None
    }


def ratio(cell: Cell, base: Cell, metric: str) -> float | None:
    """Return the ratio of the means of a run's metric; None where a run lacks it or it is 0."""
    ours = [row["metrics"].get(metric) for row in cell.finished]
    theirs = [row["metrics"].get(metric) for row in base.finished]
    if not all(ours) or not all(theirs):
        return None
    return fmean(ours) / fmean(theirs)
