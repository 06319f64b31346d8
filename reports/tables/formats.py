"""One table as plain text, Markdown, HTML and CSV; :mod:`latex` writes it in LaTeX.

A :class:`Table` holds text that is already rounded and says which entry is best; nothing is
decided here. Every renderer is pure and ends its output with a newline.
"""

import csv as csv_module
import io
import re
import textwrap
from dataclasses import dataclass, replace
from html import escape

import markupsafe

from reports.markdown import items, table_cell

TERMINAL_WIDTH = 80
GAP, NARROW_GAP = 2, 1  # blanks between columns; numbers have one behind them, or the `*`
SHORTER = {"Size(MB)↓": "MB↓"}  # headings of narrow tables
TO_THE_SECOND = re.compile(r"(\d+h \d\dm) \d\ds")  # of hours; the narrowest leave seconds out
RUN = "Run"  # heading of the column of run ids
CODE = re.compile(r"`([^`]+)`")  # settings and fields in sentences
INTERVAL = ("low", "high", "median")  # of an entry, columns of the CSV where some entry has it
SHORT_ID = 8  # letters of a run id that a terminal shows


@dataclass(frozen=True)
class Entry:
    """One number or word; ``aside`` stands in brackets behind its spread.

    ``value``, ``deviation``, the ends of its interval and its median keep full precision for the
    CSV.
    """

    text: str
    spread: str = ""
    best: bool = False
    value: float | None = None
    deviation: float | None = None
    aside: str = ""
    low: float | None = None
    high: float | None = None
    median: float | None = None

    @property
    def around(self) -> str:
        """Spread and aside as printed behind the number."""
        return " ".join(filter(None, (self.spread, f"({self.aside})" if self.aside else "")))

    @property
    def full(self) -> str:
        """Number, spread and aside as printed."""
        return f"{self.text}{' ±' if self.spread else ''} {self.around}".rstrip()


@dataclass(frozen=True)
class Line:
    """One row of a table: its label, entries, the runs it came from, marks of footnotes."""

    label: str
    entries: tuple[Entry, ...]
    runs: tuple[str, ...] = ()
    marks: str = ""
    quoted: bool = False  # somebody else's values, printed beside ours

    @property
    def name(self) -> str:
        """Label with its marks."""
        return self.label + self.marks


@dataclass(frozen=True)
class Group:
    """Lines that are compared with one another."""

    label: str
    lines: tuple[Line, ...]


@dataclass(frozen=True)
class Table:
    """``slug`` names files; ``headings`` fit the entries; ``keys`` are the CSV's column names.

    ``number`` is a Roman numeral where the paper numbers the table, else empty.
    """

    slug: str
    title: str
    headings: tuple[str, ...]
    keys: tuple[str, ...]
    groups: tuple[Group, ...]
    notes: tuple[str, ...] = ()
    first: str = "Method"
    with_runs: bool = True
    number: str = ""

    @property
    def heading(self) -> str:
        """Number and title, for formats that do not number by themselves."""
        return f"Table {self.number}. {self.title}" if self.number else self.title


def plain(table: Table) -> str:
    """Align for a terminal: at most 80 columns where the labels allow it, ``*`` for the best."""
    body, gap = _fitting(table)
    widths = [max(len(row[i]) for row in body) for i in range(len(body[0]))]
    rule = "─" * _width(body, gap)
    lines = [table.heading, rule, _aligned(body[0], widths, gap), rule]
    label = None
    for row, group in zip(body[1:], _groups_of(table, len(body) - 1), strict=True):
        if group != label and label is not None:
            lines.append("")
        label = group
        lines.append(_aligned(row, widths, gap))
    lines.append(rule)
    for note in table.notes:
        lines += _wrapped(note)
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _fitting(table: Table) -> tuple[list[list[str]], int]:
    """Return the rows that fit a terminal with least lost, and the blanks between their columns.

    Columns move together first, then spreads go below their numbers, then the runs are left out,
    and last the seconds beside hours.
    """
    without_runs = replace(table, with_runs=False)
    for form, inline in ((table, True), (table, False), (without_runs, False)):
        for gap in (GAP, NARROW_GAP):
            body = _plain_rows(form, inline=inline, short=gap == NARROW_GAP)
            if _width(body, gap) <= TERMINAL_WIDTH:
                return body, gap
    return [[TO_THE_SECOND.sub(r"\1", cell) for cell in row] for row in body], gap


def _plain_rows(table: Table, *, inline: bool, short: bool) -> list[list[str]]:
    run_heading = [RUN] if table.with_runs else []
    heads = (SHORTER.get(text, text) if short else text for text in table.headings)
    rows = [["", table.first, *(f"{text} " for text in heads), *run_heading]]
    for group in table.groups:
        for index, line in enumerate(group.lines):
            runs = [" ".join(run[:SHORT_ID] for run in line.runs) or "–"] if table.with_runs else []
            texts = [(e.full.replace(" ± ", "±") if inline else e.text) for e in line.entries]
            marked = [
                t + ("*" if e.best else " ") for t, e in zip(texts, line.entries, strict=True)
            ]
            rows.append([group.label if index == 0 else "", line.name, *marked, *runs])
            if not inline and any(e.spread for e in line.entries):
                below = [f"±{e.around} " if e.spread else "" for e in line.entries]
                rows.append(["", "", *below, *([""] if table.with_runs else [])])
    return rows


def _groups_of(table: Table, rows: int) -> list[str]:
    """Name the group of each printed row, so that groups can be set apart."""
    lines = [group.label for group in table.groups for _ in group.lines]
    factor = rows // len(lines) if lines else 1
    if factor * len(lines) == rows:
        return [label for label in lines for _ in range(factor)]
    out = []
    for group in table.groups:
        for line in group.lines:
            out += [group.label] * (2 if any(e.spread for e in line.entries) else 1)
    return out


def _width(rows: list[list[str]], gap: int) -> int:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return sum(widths) + gap * (len(widths) - 1)


def _aligned(row: list[str], widths: list[int], gap: int) -> str:
    """Words to the left, numbers to the right; headings stand over their numbers' last digit."""
    out = []
    for index, (cell, width) in enumerate(zip(row, widths, strict=True)):
        last_is_run = index == len(row) - 1 and not cell.endswith(("*", " "))
        out.append(cell.ljust(width) if index < 2 or last_is_run else cell.rjust(width))
    return (" " * gap).join(out)


def _wrapped(note: str) -> list[str]:
    return textwrap.wrap(note, TERMINAL_WIDTH, subsequent_indent="  ", break_long_words=False)


def markdown(table: Table) -> str:
    """GitHub's pipe tables; best in bold, runs in code spans, notes as a list."""
    heads = ["", table.first, *table.headings] + ([RUN] if table.with_runs else [])
    aligns = ["---", "---"] + ["--:"] * len(table.headings) + (["---"] if table.with_runs else [])
    out = [f"### {table.heading}", "", _pipes(heads), _pipes(aligns)]
    for group in table.groups:
        for index, line in enumerate(group.lines):
            entries = [f"**{e.full}**" if e.best else e.full for e in line.entries]
            label = f"*{line.name}*" if line.quoted else line.name
            runs = (
                [" ".join(f"`{run[:SHORT_ID]}`" for run in line.runs) or "–"]
                if table.with_runs
                else []
            )
            out.append(_pipes([group.label if index == 0 else "", label, *entries, *runs]))
    out += ["", *items(table.notes)] if table.notes else []
    return "\n".join(out).rstrip() + "\n"


def _pipes(cells: list[str]) -> str:
    return "| " + " | ".join(map(table_cell, cells)) + " |"


def html(table: Table) -> str:
    """Write a ``figure`` with the table, its caption and notes; styled by the page."""
    heads = [table.first, *table.headings] + ([RUN] if table.with_runs else [])
    head = '<th scope="col"></th>' + "".join(_html_head(h) for h in heads)
    body = []
    for group in table.groups:
        body.append("<tbody>")
        for index, line in enumerate(group.lines):
            first = (
                f'<th scope="rowgroup" rowspan="{len(group.lines)}">{escape(group.label)}</th>'
                if index == 0
                else ""
            )
            runs = (
                f'<td class="run">{" ".join(_run(run) for run in line.runs) or "–"}</td>'
                if table.with_runs
                else ""
            )
            kind = ' class="quoted"' if line.quoted else ""
            cells = "".join(_html_entry(entry) for entry in line.entries)
            body.append(
                f'<tr{kind}>{first}<th scope="row">{escape(line.name)}</th>{cells}{runs}</tr>'
            )
        body.append("</tbody>")
    notes = "".join(f"<li>{prose(note)}</li>" for note in table.notes)
    return (
        f'<figure class="table" id="{escape(table.slug)}"><figcaption>{escape(table.heading)}'
        f'</figcaption><div class="scroll"><table><thead><tr>{head}</tr></thead>{"".join(body)}'
        f"</table></div>{f'<ul class=notes>{notes}</ul>' if notes else ''}</figure>\n"
    )


def prose(text: str) -> str:
    """Return a sentence as HTML, what stands between backticks as code."""
    return CODE.sub(r"<code>\1</code>", str(markupsafe.escape(text)))  # as templates escape


def _html_head(text: str) -> str:
    kind = ' class="run"' if text == RUN else ""
    return f'<th scope="col"{kind}>{escape(text)}</th>'


def _run(run: str) -> str:
    return f'<code title="{escape(run)}">{escape(run[:SHORT_ID])}</code>'


def _html_entry(entry: Entry) -> str:
    spread = f' <span class="spread">± {escape(entry.spread)}</span>' if entry.spread else ""
    aside = f'<br><span class="spread">{escape(entry.aside)}</span>' if entry.aside else ""
    inner = escape(entry.text) + spread + aside
    return f"<td><b>{inner}</b></td>" if entry.best else f"<td>{inner}</td>"


def csv(table: Table) -> str:
    """Full precision: per column its mean and, where there are several seeds, its deviation.

    Columns that have intervals or medians have those, too.
    """
    out = io.StringIO()
    writer = csv_module.writer(out, lineterminator="\n")
    lines = [(group.label, line) for group in table.groups for line in group.lines]
    parts = [
        ("deviation", *(p for p in INTERVAL if any(_part(line, i, p) for _, line in lines)))
        for i in range(len(table.keys))
    ]
    named = zip(table.keys, parts, strict=True)
    keys = [name for key, own in named for name in (key, *(f"{key}_{part}" for part in own))]
    writer.writerow(["group", table.first.lower(), *keys, "runs"])
    for label, line in lines:
        values = []
        for i, own in enumerate(parts):
            values += [_number(line.entries[i]), *(_part(line, i, part) for part in own)]
        writer.writerow([label, line.label, *values, " ".join(line.runs)])
    return out.getvalue()


def _part(line: Line, place: int, name: str) -> str:
    return _exact(getattr(line.entries[place], name))


def _number(entry: Entry) -> str:
    return entry.text if entry.value is None else _exact(entry.value)


def _exact(value: float | None) -> str:
    return "" if value is None else repr(value)
