"""The page of a benchmark's history: steps first, then every cell with a chart per metric.

One file with everything inside it: it opens offline and fetches nothing.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mattgs_ops.whole_file import write_text_whole
from reports.history import charts
from reports.history.series import (
    FoundStep,
    Point,
    Run,
    Series,
    all_series,
    found_steps,
    points_of,
)
from reports.rows.schema import capture_name, condition_name, key_of
from reports.templates import environment

TEMPLATES = Path(__file__).with_name("templates")
PAGE, DATA = "history.html", "history.json"


@dataclass(frozen=True)
class Built:
    """The page that was written, and what is on it."""

    page: Path
    summary: str
    steps: tuple[FoundStep, ...]


def build(runs: Sequence[Run], folder: Path, *, title: str) -> Built:
    """Write the page and its numbers into ``folder``."""
    series = all_series(runs)
    steps = found_steps(series)
    data = json.dumps([_numbers(one) for one in series], indent=1, sort_keys=True)
    write_text_whole(folder / DATA, data + "\n")
    page = folder / PAGE
    sentence = summary(runs, series, steps)
    html = render(series, steps, title=title, summary=sentence)
    write_text_whole(page, html)
    return Built(page, sentence, tuple(steps))


def render(
    series: Sequence[Series], steps: Sequence[FoundStep], *, title: str, summary: str
) -> str:
    """Return the page's HTML."""
    template = environment(TEMPLATES).get_template("history.html.j2")
    return template.render(
        title=title,
        summary=summary,
        steps=[describe(step) for step in steps],
        captures=_captures(series),
        style=(TEMPLATES / "history.css").read_text(encoding="utf-8"),
    )


def summary(runs: Sequence[Run], series: Sequence[Series], steps: Sequence[FoundStep]) -> str:
    """Say in one sentence how much there is, and how many steps."""
    cells = {one.cell for one in series}
    by_cell: dict[Any, list[Run]] = {}
    for run in runs:
        by_cell.setdefault(key_of(run), []).append(run)
    commits = {point.commit for mine in by_cell.values() for point in points_of(mine)}
    parts = _many(len(runs), "run"), _many(len(cells), "cell"), _many(len(commits), "commit")
    return "{} of {} on {}; {}.".format(*parts, _many(len(steps), "step"))


def _many(count: int, word: str) -> str:
    return f"{count or 'no'} {word}{'' if count == 1 else 's'}"


def describe(found: FoundStep) -> dict[str, str]:
    """Return a step's parts as words: kind, cell, metric, before, after, first and last commit."""
    column, step = found.series.column, found.step
    kinds = {True: "better", False: "worse", None: "changed"}
    return {
        "kind": kinds[found.better],
        "cell": str(found.series.cell),
        "metric": column.label,
        "before": charts.text_of(column, step.before),
        "after": charts.text_of(column, step.after),
        "first": found.first.commit,
        "last": found.last_before.commit,
        "when": charts.moment(found.first),
        "anchor": _anchor(found.series),
    }


def _anchor(series: Series) -> str:
    cell = series.cell
    size = cell.iterations, cell.resolution, cell.budget
    parts = (cell.capture, cell.condition, *size, series.column.key)
    return "-".join(str(part) for part in parts).replace("+", "plus")


def _captures(series: Sequence[Series]) -> list[dict[str, Any]]:
    """Nest charts by capture and cell, in the order of the series."""
    captures: dict[str, dict[str, Any]] = {}
    for one in series:
        capture = captures.setdefault(
            one.cell.capture, {"name": capture_name(one.cell.capture), "cells": {}}
        )
        name = condition_name(one.cell.background, one.cell.method)
        size = f"{one.cell.iterations:,} iterations, {one.cell.resolution} px"
        size += f", at most {one.cell.budget:,} splats" if one.cell.budget else ""
        cell = capture["cells"].setdefault(one.cell, {"name": name, "size": size, "metrics": {}})
        cell["metrics"].setdefault(one.column.key, []).append(one)
    for capture in captures.values():
        for cell in capture["cells"].values():
            cell["charts"] = [_chart(mine) for mine in cell.pop("metrics").values()]
        capture["cells"] = list(capture["cells"].values())
    return list(captures.values())


def _chart(series: Sequence[Series]) -> dict[str, str]:
    newest = max((one for one in series if one.measured()), key=lambda one: _last(one)[0].when)
    column, value = newest.column, _last(newest)[1]
    return {
        "anchor": _anchor(newest),
        "label": column.heading,
        "newest": charts.text_of(column, value),
        "svg": charts.draw(series),
    }


def _last(series: Series) -> tuple[Point, float]:
    """Return the newest point with a value, and the value."""
    index = series.measured()[-1]
    value = series.values[index]
    assert value is not None  # measured() says so
    return series.points[index], value


def _numbers(one: Series) -> Mapping[str, Any]:
    """Return a series as JSON values."""
    points = [
        {
            "when": charts.moment(point),
            "commit": point.runs[0].get("git"),
            "code_version": point.runs[0].get("code_version"),
            "value": value,
            "runs": [run["run_id"] for run in point.runs],
            "gate": (point.verdict(one.column.key) or (None,))[0],
        }
        for point, value in zip(one.points, one.values, strict=True)
    ]
    steps = [{"first": s.first, "before": s.before, "after": s.after} for s in one.steps]
    return {"cell": str(one.cell), "metric": one.column.key, "points": points, "steps": steps}
