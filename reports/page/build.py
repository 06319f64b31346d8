"""Rows in, a folder of report out: page, Markdown, tables and figures.

The same rows give the same bytes: nothing is stamped with a date, a host or a random number, and
rows are sorted before anything is written. What is missing is listed in the report.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from reports.figures import budgets as budget_figures
from reports.figures import mask_sheets, photos, pictures, plots, trade_off
from reports.figures.pictures import Gallery
from reports.figures.plots import Saved
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
) -> Path:
    """Write the report of ``rows`` into ``out`` and return the path of ``report.html``.

    ``artifacts_root`` is the folder that rows' artifacts are relative to; without it (or where an
    artifact is not on this disk) the pictures are left out and listed as missing. ``summary`` is
    printed under the title as label and value; None: the rows' settings and machines.
    ``baselines`` are the rows of the promoted runs, which are marked and compared with. ``values``
    are the paper's own; None: those that come with the project. ``notes`` are sentences that a
    reader must know; ``planned`` says how many experiments there are to be, None: as many as
    rows. A report that lies there as it would come out is left alone (``unchanged.py``). Raises
    :class:`InputError` for rows that do not say which cell they belong to.
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
    _write(out / "rows.json", json.dumps(good, indent=1, sort_keys=True, allow_nan=False) + "\n")
    against = promoted.promoted_table(good, baselines)
    tables = [*all_tables(good, values), *([] if against is None else [against])]
    for table in tables:
        for suffix, form in FORMATS.items():
            _write(out / "tables" / f"{table.slug}.{suffix}", form(table))
    compared = of_one_setting(good)
    one_each = largest(compared)  # pictures and verdicts are of the largest budgets
    shown = captures(one_each)
    galleries = [pictures.gallery(name, cells(one_each), artifacts_root) for name in shown]
    with plots.style():
        first = budget_figures.budget_curves(compared, out / "figures")
    # curves say more than their largest budgets' points
    drawn = _draw(one_each, galleries, artifacts_root, out / "figures", points=not first)
    overall = verdict.overall(one_each)
    judged = [*([] if overall is None else [overall]), *verdict.verdicts(one_each)]
    line = verdict.summary_line(good, planned)
    notes = [*notes, *setting_notes(good), *([LARGEST] if first else []), *origins.notes(good)]
    notes += [*clock_notes(good), *haze_notes(good)]
    warned = warnings(good)
    html = page.render(
        title=title,
        summary=line,
        facts=dict(verdict.facts(good) if summary is None else summary),
        verdicts=judged,
        tables=tables,
        figures=drawn,
        first=first,
        galleries=galleries,
        root=artifacts_root,
        problems=wrong,
        notes=notes,
        warnings=warned,
    )
    missing = [*wrong, *pictures.missing_pictures(galleries)]
    words = _markdown(title, line, warned, judged, notes, tables, first, drawn, missing, out)
    _write(out / "report.md", words)
    _write(path, html)
    unchanged.note(out, made_of)
    return path


def _draw(
    rows: Sequence[Row],
    galleries: Sequence[Gallery],
    root: Path | None,
    folder: Path,
    *,
    points: bool,
) -> list[Saved]:
    """Draw all figures; those of single ``points`` of quality and cost where they are wanted."""
    with plots.style():
        drawn = [
            *(trade_off.trade_offs(rows, folder) if points else ()),
            *plots.training_curves(rows, root, folder),
        ]
        pictorial = photos.all_photo_figures(galleries, cells(rows), root, folder)
        masks = [mask_sheets.sheet(rows, name, root, folder) for name in captures(rows)]
        pictorial += [one for one in masks if one is not None]
    return [*pictorial, *drawn]


def _markdown(
    title: str,
    line: str,
    warned: Sequence[str],
    judged: Sequence[verdict.Verdict],
    notes: Sequence[str],
    tables: Sequence[Table],
    first: Sequence[Saved],
    drawn: Sequence[Saved],
    missing: Sequence[str],
    out: Path,
) -> str:
    parts = [f"# {title}", "", line, ""]
    if warned:
        parts += ["## Warnings", "", *(f"- **{text}**" for text in warned), ""]
    if first:
        parts += ["## What a budget buys", "", *_pictures(first, out)]
        parts += [formats.markdown(table) for table in tables if table.slug == BUDGETS]
        tables = [table for table in tables if table.slug != BUDGETS]
    parts += ["## Verdict", ""]
    for one in judged:
        parts.append(f"- **{one.headline}**")
        parts += [f"  - {detail}" for detail in one.details]
    if notes:
        parts += ["", "To know when reading this:", "", *(f"- {text}" for text in notes)]
    parts += ["", "## Tables", ""]
    parts += [formats.markdown(table) for table in tables]
    if drawn:
        parts += ["## Figures", "", *_pictures(drawn, out)]
    if missing:
        parts += ["## Not shown", "", *(f"- {text}" for text in missing), ""]
    return "\n".join(parts).rstrip() + "\n"


def _pictures(drawn: Sequence[Saved], out: Path) -> list[str]:
    parts = []
    for figure in drawn:
        link = figure.png.relative_to(out).as_posix()
        parts += [f"![{figure.caption}]({link})", "", f"*{figure.caption}*", ""]
    return parts


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")
