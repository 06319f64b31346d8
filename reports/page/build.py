"""Rows in, a folder of report out: page, Markdown, tables and figures.

The same rows give the same bytes: nothing is stamped with a date, a host or a random number, and
rows are sorted before anything is written. What is missing is listed in the report.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mattgs_ops.whole_file import write_text_whole
from reports.figures import all_figures, pictures, plots
from reports.figures import budgets as budget_figures
from reports.figures.plots import Saved
from reports.markdown import items, plain
from reports.page import page, unchanged
from reports.rows.budgets import largest
from reports.rows.clock import clock_notes
from reports.rows.doubts import warnings
from reports.rows.finite import without_infinite_views
from reports.rows.schema import Row, captures, cells, problems, refused
from reports.rows.settings import of_one_setting, setting_notes
from reports.tables import formats, latex, origins, paper, promoted, verdict
from reports.tables.formats import Table
from reports.tables.notes import haze_notes
from reports.tables.side_tables import BUDGETS, all_tables

LARGEST = "Verdicts, pictures and training curves are those of each condition's largest budget."
PAGE = "report.html"
FORMATS = {"md": formats.markdown, "tex": latex.latex, "csv": formats.csv}


@dataclass(frozen=True)
class Content:
    """What the page and the Markdown both say.

    ``line`` is the summary, ``first`` the figures that stand before all else, ``drawn`` the others;
    ``problems`` say what is wrong with rows.
    """

    title: str
    line: str
    warned: Sequence[str]
    judged: Sequence[verdict.Verdict]
    notes: Sequence[str]
    tables: Sequence[Table]
    first: Sequence[Saved]
    drawn: Sequence[Saved]
    problems: Sequence[str]


def build(
    rows: Sequence[Row],
    out: Path,
    *,
    title: str,
    artifacts_root: Path | None,
    summary: Mapping[str, Any] | None = None,
    baselines: Sequence[Row] = (),
    values: paper.PaperValues | None = None,
    notes: Sequence[str] = (),
    planned: int | None = None,
    processes: int = 1,
) -> Path:
    """Write the report of ``rows`` into ``out`` and return the path of ``report.html``.

    ``artifacts_root`` is the folder that rows' artifacts are relative to; without it (or where an
    artifact is not on this disk) the pictures are left out and listed as missing. ``summary`` is
    printed under the title as label and value; None: the rows' settings and machines.
    ``baselines`` are the rows of the promoted runs, which are marked and compared with. ``values``
    are the paper's own; None: those that come with the project. ``notes`` are sentences that a
    reader must know; ``planned`` says how many experiments there are to be, None: as many as
    rows; ``processes`` draw figures at a time. A report that lies there as it would come out is
    left alone (``unchanged.py``). Raises :class:`InputError` for rows that do not say which cell
    they belong to.
    """
    printed: dict[str, Any] = {
        "title": title,
        "summary": summary,
        "notes": notes,
        "planned": planned,
    }
    printed |= {"baselines": list(baselines), "values": repr(values)}
    wrong = problems(rows)
    rows, infinite = without_infinite_views(refused(rows))  # what is left is valid JSON
    wrong += infinite
    made_of = unchanged.recipe(rows, artifacts_root, printed)
    path = out / PAGE
    if unchanged.holds(out, made_of):
        return path
    good = [row for cell in cells(promoted.mark(rows, baselines)) for row in cell.rows]
    out.mkdir(parents=True, exist_ok=True)
    write_text_whole(
        out / "rows.json", json.dumps(good, indent=1, sort_keys=True, allow_nan=False) + "\n"
    )
    against = promoted.promoted_table(good, baselines)
    tables = [*all_tables(good, values), *([] if against is None else [against])]
    _write_tables(tables, out / "tables")
    compared = of_one_setting(good)
    one_each = largest(compared)  # pictures and verdicts are of the largest budgets
    galleries = [
        pictures.gallery(name, cells(one_each), artifacts_root) for name in captures(one_each)
    ]
    absent = pictures.missing_pictures(galleries)
    folder = out / "figures"
    with plots.style():
        first = budget_figures.budget_curves(compared, folder)
    # curves say more than their largest budgets' points
    parts = all_figures.parts(one_each, galleries, artifacts_root, folder, points=not first)
    # without pictures there are one or two, and a process takes longer to start than to draw them
    needed = processes if any(row.get("artifacts") for row in one_each) else 1
    with all_figures.drawn_by(needed, parts) as drawn_in_the_end:
        shown = page.shown(galleries, artifacts_root)
        drawn = drawn_in_the_end()
    content = Content(
        title=title,
        line=verdict.summary_line(good, planned),
        warned=warnings(good),
        judged=_judged(one_each),
        notes=[*notes, *_notes(good, budgets=bool(first))],
        tables=tables,
        first=first,
        drawn=drawn,
        problems=wrong,
    )
    facts = dict(verdict.facts(good) if summary is None else summary)
    write_text_whole(out / "report.md", _markdown(content, absent, out))
    missing = pictures.missing_pictures(galleries)  # of sliders and 3D views, too
    write_text_whole(path, _html(content, facts, shown, missing))
    unchanged.note(out, made_of)
    return path


def _write_tables(tables: Sequence[Table], folder: Path) -> None:
    for table in tables:
        for suffix, form in FORMATS.items():
            write_text_whole(folder / f"{table.slug}.{suffix}", form(table))


def _judged(rows: Sequence[Row]) -> list[verdict.Verdict]:
    """Return the verdicts, the one on all captures first."""
    overall = verdict.overall(rows)
    return [*([] if overall is None else [overall]), *verdict.verdicts(rows)]


def _notes(rows: Sequence[Row], *, budgets: bool) -> list[str]:
    """Return what a reader of the rows must know, with ``budgets`` that they are of several."""
    largest_ones = [LARGEST] if budgets else []
    of_runs = [*setting_notes(rows), *largest_ones, *origins.notes(rows)]
    return [*of_runs, *clock_notes(rows), *haze_notes(rows)]


def _html(
    content: Content,
    facts: Mapping[str, Any],
    shown: Sequence[Mapping[str, Any]],
    missing: Sequence[str],
) -> str:
    return page.render(
        title=content.title,
        summary=content.line,
        facts=facts,
        verdicts=content.judged,
        tables=content.tables,
        figures=content.drawn,
        first=content.first,
        captures=shown,
        missing=missing,
        problems=content.problems,
        notes=content.notes,
        warnings=content.warned,
    )


def _markdown(content: Content, absent: Sequence[str], out: Path) -> str:
    """Write the report as Markdown; ``absent`` says which pictures are."""
    tables, missing = content.tables, [*content.problems, *absent]
    parts = [f"# {content.title}", "", content.line, ""]
    if content.warned:
        parts += ["## Warnings", "", *items(f"**{text}**" for text in content.warned), ""]
    if content.first:
        parts += ["## What a budget buys", "", *_pictures(content.first, out)]
        parts += [formats.markdown(table) for table in tables if table.slug == BUDGETS]
        tables = [table for table in tables if table.slug != BUDGETS]
    parts += ["## Verdict", ""]
    for one in content.judged:
        parts += items([f"**{one.headline}**"])
        parts += [f"  {item}" for item in items(one.details)]
    if content.notes:
        parts += ["", "To know when reading this:", "", *items(content.notes)]
    parts += ["", "## Tables", ""]
    parts += [formats.markdown(table) for table in tables]
    if content.drawn:
        parts += ["## Figures", "", *_pictures(content.drawn, out)]
    if missing:
        parts += ["## Not shown", "", *items(missing), ""]
    return "\n".join(parts).rstrip() + "\n"


def _pictures(drawn: Sequence[Saved], out: Path) -> list[str]:
    parts = []
    for figure in drawn:
        link = figure.png.relative_to(out).as_posix()
        caption = plain(figure.caption)
        parts += [f"![{caption}]({link})", "", f"*{caption}*", ""]
    return parts
