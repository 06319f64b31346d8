"""Iterations and resolution: only rows of one setting are compared with each other.

Rows of one benchmark may have several settings, as after a longer run of the same name. Tables I to
III print each apart. What compares cells (verdicts, differences, curves, figures) is of one.
"""

from collections import Counter
from collections.abc import Sequence

from reports.rows.schema import Row

Setting = tuple[int, int]  # iterations, resolution


def setting_of(row: Row) -> Setting:
    """Return a row's iterations and resolution."""
    return int(row["iterations"]), int(row["resolution"])


def of_one_setting(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of the setting that most experiments finished at; of several the longest."""
    finished = Counter(setting_of(row) for row in rows if row["status"] == "finished")
    if not finished:
        return list(rows)
    chosen = max(finished, key=lambda one: (finished[one], one))
    return [row for row in rows if setting_of(row) == chosen]


def setting_notes(rows: Sequence[Row]) -> list[str]:
    """Say of which setting the comparisons are and which others there are; empty for one."""
    counts = Counter(map(setting_of, rows))
    kept = of_one_setting(rows)
    if len(kept) == len(rows):
        return []
    chosen = setting_of(kept[0])
    others = ", ".join(
        f"{_printed(one)} ({count} experiments)"
        for one, count in sorted(counts.items())
        if one != chosen
    )
    text = f"Verdicts, differences and figures are of {_printed(chosen)}"
    return [f"{text}, at which most experiments finished. Tables I to III also print {others}."]


def _printed(setting: Setting) -> str:
    iterations, resolution = setting
    return f"{iterations:,} iterations at {resolution} px"
