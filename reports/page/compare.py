"""Two runs of one capture side by side: a table, and a page with a slider over their test views."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mattgs_ops.errors import InputError
from mattgs_ops.whole_file import write_text_whole
from reports.figures.pictures import Gallery, gallery, missing_pictures
from reports.page import page
from reports.rows import clock, comparable
from reports.rows.columns import (
    COLOUR_CORRECTED,
    CPU_TIME,
    IN_MASK,
    PAPER,
    Column,
    signed,
    signed_text,
    text,
)
from reports.rows.doubts import in_doubt, warnings
from reports.rows.schema import Row, capture_name, cells, condition_name, held_out_views
from reports.rows.statistics import Interval, sample
from reports.tables.formats import Entry, Group, Line, Table
from reports.tables.origins import machine_of
from reports.tables.tables import SPEEDS
from reports.tables.verdict import Verdict, withheld

SHORT = 8  # letters of a run's id
IDENTITY = ("benchmark", "background", "method", "seed", "iterations", "resolution")
DECIDES = "mask_psnr"  # the score that the headline is about; full frames score white pixels
NOT_A_SETTING = ("capture", *IDENTITY)  # in the settings too, under the same names


@dataclass(frozen=True)
class Side:
    """One of the two runs.

    ``root`` is the folder that its row's artifacts are relative to, None where they are not here;
    ``settings`` are its configuration, flat, empty where it is not known.
    """

    row: Row
    root: Path | None
    settings: Mapping[str, str]

    @property
    def name(self) -> str:
        """What tables and the slider call it."""
        row = self.row
        identity = str(row.get("run_id") or "")[:SHORT]
        shown = f"{condition_name(row['background'], row['method'])} seed {row['seed']}"
        return f"{shown} ({identity or row['benchmark']})"


def compare(first: Side, second: Side, folder: Path) -> tuple[list[Table], str, Path]:
    """Write ``compare.html`` into ``folder``; return the tables, the headline and the page's path.

    Raises :class:`InputError` for runs of different captures and for runs that did not finish.
    """
    for side in (first, second):
        if side.row["status"] != "finished":
            raise InputError(f"{side.name}: expected a finished run, found {side.row['status']}")
    names = [side.row["capture"] for side in (first, second)]
    if names[0] != names[1]:
        raise InputError(f"expected two runs of one capture, found {names[0]} and {names[1]}")
    tables = [scores(first, second), *differing(first, second)]
    headline = judged(first, second)
    found = _gallery(first, second)
    shown = page.shown([found], Path("/"))  # adds to what the gallery misses
    html = page.render(
        title=f"{capture_name(names[0])}: two runs",
        summary=f"A: {first.name}. B: {second.name}.",
        facts={},
        verdicts=[Verdict("", headline, ())],
        tables=tables,
        figures=[],
        captures=shown,
        missing=missing_pictures([found]),
        notes=notes(first, second),
        warnings=warnings([first.row, second.row]),
    )
    path = folder / "compare.html"
    write_text_whole(path, html)
    return tables, headline, path


def scores(first: Side, second: Side) -> Table:
    """Return the table of scores: A, B and B − A.

    The better one of each line is marked where the two compare: scores of one background, or those
    that compare across backgrounds; times and speeds of one machine, where none had to wait.
    """
    frame = (*PAPER, COLOUR_CORRECTED, CPU_TIME)
    groups = [
        Group("Full frame, cost", _lines(first, second, frame)),
        Group("In the mask", _lines(first, second, IN_MASK)),
    ]
    return Table(
        "compare",
        "Scores of both runs",
        ("A", "B", "B − A"),
        ("a", "b", "difference"),
        tuple(group for group in groups if group.lines),
        (
            f"A: {first.name}.",
            f"B: {second.name}.",
            *warnings([first.row, second.row]),
            *notes(first, second),
        ),
        first="Score",
        with_runs=False,
    )


def differing(first: Side, second: Side) -> list[Table]:
    """Return the table of what was asked of the runs and differs; none where nothing does."""
    pairs = [(name, str(first.row[name]), str(second.row[name])) for name in IDENTITY]
    if first.settings and second.settings:
        keys = sorted(first.settings.keys() | second.settings.keys())
        pairs += [
            (key, first.settings.get(key, "–"), second.settings.get(key, "–"))
            for key in keys
            if key not in NOT_A_SETTING
        ]
    lines = tuple(Line(n, (Entry(a), Entry(b))) for n, a, b in pairs if a != b)
    if not lines:
        return []
    return [
        Table(
            "differs",
            "What was asked differently",
            ("A", "B"),
            ("a", "b"),
            (Group("Settings", lines),),
            first="Setting",
            with_runs=False,
        )
    ]


def judged(first: Side, second: Side) -> str:
    """Return the sentence on PSNR inside the mask, over the held-out views that both have.

    None is given of a capture in doubt.
    """
    for capture, subjects in in_doubt([first.row, second.row]).items():
        return withheld(capture, subjects)
    theirs = {view["view"]: view.get(DECIDES) for view in held_out_views(first.row)}
    ours = {view["view"]: view.get(DECIDES) for view in held_out_views(second.row)}
    shared = sorted(name for name in ours.keys() & theirs.keys() if _both(ours, theirs, name))
    if not shared:
        return "The runs share no held-out view that was scored inside the mask."
    gains = [float(ours[name]) - float(theirs[name]) for name in shared]  # type: ignore[arg-type]
    better = sum(gain > 0 for gain in gains)
    interval = sample(gains)
    return (
        f"B is {signed(interval.mean)} dB from A in PSNR inside the mask, better on {better} of "
        f"{len(gains)} held-out views{_certainty(interval)}."
    )


def notes(first: Side, second: Side) -> list[str]:
    """Return why scores or times of the two do not compare, as far as the rows tell."""
    both = second.row, first.row
    found = [f"B: {text}" for text in comparable.leaks(second.row)]
    found += [f"A: {text}" for text in comparable.leaks(first.row)]
    found += _by_letter(comparable.other_protocol(*both)) + comparable.other_inputs(*both)
    found += comparable.other_views(*both) + _by_letter(comparable.other_truth(*both))
    if first.row["background"] != second.row["background"]:
        found.insert(
            0,
            "Without background, white pixels come for free: compare PSNR and L1 in the mask only.",
        )
    if machine_of(first.row) != machine_of(second.row):
        found.append("Times and FPS are of different machines and do not compare.")
    return found + clock.clock_notes([first.row, second.row])


def _by_letter(sentences: Sequence[str]) -> list[str]:
    """Call a gate's two sides as the page does, in sentences that hold no names of photos."""
    return [text.replace("baseline", "A").replace("candidate", "B") for text in sentences]


def _certainty(interval: Interval) -> str:
    if not np.isfinite(interval.low):
        return ""
    return f" (95 % interval {signed(interval.low)} to {signed(interval.high)} dB)"


def _both(ours: Mapping[str, Any], theirs: Mapping[str, Any], name: str) -> bool:
    return all(isinstance(scored[name], int | float) for scored in (ours, theirs))


def _lines(first: Side, second: Side, columns: tuple[Column, ...]) -> tuple[Line, ...]:
    lines = []
    for column in columns:
        pair = [side.row["metrics"].get(column.key) for side in (first, second)]
        if not all(isinstance(value, int | float) for value in pair):
            continue
        a, b = map(float, pair)
        shown = [text(column.kind, value) for value in (a, b)]
        differ = shown[0] != shown[1] and _compares(first.row, second.row, column)
        better = column.direction * (b - a) if differ else 0.0
        lines.append(
            Line(
                column.heading,
                (
                    Entry(shown[0], best=better < 0, value=a),
                    Entry(shown[1], best=better > 0, value=b),
                    Entry(signed_text(column.kind, b - a), value=b - a),
                ),
            )
        )
    return tuple(lines)


def _compares(first: Row, second: Row, column: Column) -> bool:
    """Whether the values of two rows may be judged against each other."""
    if first["background"] != second["background"] and not column.across:
        return False
    if column.kind not in SPEEDS:
        return True
    waited = column.key == clock.WALL and bool(clock.clock_notes([first, second]))
    return machine_of(first) == machine_of(second) and not waited


def _gallery(first: Side, second: Side) -> Gallery:
    """Return the pictures of both as two lanes over the views that both rendered."""
    out = Gallery(str(first.row["capture"]))
    for mark, side in (("A", first), ("B", second)):
        mine = gallery(out.capture, cells([side.row]), side.root)
        out.rows[mark] = side.row | {
            "method": f"{side.name.partition(' · ')[2]} {mark}",
            "artifacts": _absolute(side),
        }
        for (_, view), path in mine.renders.items():
            out.renders[mark, view] = path
        for key, path in mine.truths.items():
            out.truths.setdefault(key, path)
        out.masks |= mine.masks
        out.missing += [(mark, reason) for _, reason in mine.missing]
    return out


def _absolute(side: Side) -> dict[str, str]:
    """Return where the artifacts of a side lie: the two need not share a folder."""
    if side.root is None:
        return {}
    found = side.row.get("artifacts") or {}
    return {kind: str(side.root.resolve() / below) for kind, below in found.items()}
