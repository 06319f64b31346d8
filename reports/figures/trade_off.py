"""Quality against cost: PSNR inside the mask over size and over training time, all captures."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from reports.figures import findings
from reports.figures.plots import (
    DASHES,
    MARKS,
    Saved,
    colours,
    headed,
    legend,
    less,
    mark_of,
    mean,
    save,
    sheets,
)
from reports.rows import clock
from reports.rows.groups import finished_of
from reports.rows.schema import Cell, Row, capture_name, captures, cells, condition_name
from reports.tables.notes import where_timed
from reports.tables.origins import machine_of, measured_on, shared_machine

SLUG = "figure-trade-off"
INCOMPARABLE = "Times are of different machines and do not compare between them."


def trade_offs(rows: Sequence[Row], folder: Path) -> list[Saved]:
    """Quality inside the mask against size (upper row) and time (lower row), one column each."""
    selected = [cell for cell in cells(rows) if cell.finished]
    names = captures(row for cell in selected for row in cell.finished)
    tones = colours(rows)
    return [
        _trade_off(selected, part, tones, folder, slug, sheet)
        for slug, sheet, part in sheets(names)
    ]


def _trade_off(
    selected: Sequence[Cell],
    names: Sequence[str],
    tones: dict[str, str],
    folder: Path,
    slug: str,
    sheet: str,
) -> Saved:
    in_mask = any(mean(cell, "mask_psnr") is not None for cell in selected)
    metric = "mask_psnr" if in_mask else "psnr"
    label = "PSNR in mask (dB)" if in_mask else "PSNR (dB)"

    machine, timer = shared_machine(selected), clock.clock_of(finished_of(selected))
    mixed = len({machine_of(row) for row in finished_of(selected)}) > 1
    timed = {
        cell.key: replace(cell, finished=measured_on(machine, cell.finished)) if machine else cell
        for cell in selected
    }

    def quality(cell: Cell) -> float | None:
        return mean(cell, metric)

    def quick(cell: Cell) -> float | None:
        return less(timed[cell.key], timer)

    best = partial(findings.winners, selected, names)
    figure = Figure(figsize=(max(2.5 * len(names), 3.2) + 0.5, 4.8))
    grid = figure.subplots(2, len(names), squeeze=False)
    for place, name in enumerate(names):
        members = [cell for cell in selected if cell.key.capture == name]
        for axes, cost, text in (
            (grid[0][place], "size_mb", "Size (MB)"),
            (grid[1][place], timer, clock.AXES[timer]),
        ):
            costs = [mean(timed[cell.key] if cost == timer else cell, cost) for cell in members]
            _scatter(axes, members, costs, metric, tones)
            axes.set_xlabel(text)
        headed(grid[0][place], capture_name(name))
    for axes in grid[:, 0]:
        axes.set_ylabel(label)
    legend(figure, _handles(selected, tones))
    incomparable = mixed and not machine
    machines = ""
    if mixed:
        machines = f" {where_timed(selected, machine)}" if machine else f" {INCOMPARABLE}"
    caption = (
        best(f"Highest {label.removesuffix(' (dB)')}", quality, "db")
        + best("Smallest file", lambda cell: less(cell, "size_mb"), "mb")
        + ("" if incomparable else best("Shortest training", quick, "time"))
        + f"{label} on held-out views against file size and training {clock.WORDS[timer]}: up and "
        f"to the left is better. Lines join the methods on one background.{machines}{sheet}"
    )
    return save(figure, folder, f"{SLUG}{slug}", caption)


def _scatter(
    axes: Axes,
    members: Sequence[Cell],
    costs: Sequence[float | None],
    metric: str,
    tones: dict[str, str],
) -> None:
    for background in MARKS:
        points = []
        for cell, x in zip(members, costs, strict=True):
            y = mean(cell, metric)
            if cell.key.background == background and x is not None and y is not None:
                points.append((x, y, cell.key.method))
        axes.plot(
            [p[0] for p in points],
            [p[1] for p in points],
            color="#aab2bb",
            linewidth=0.9,
            linestyle=DASHES[background][0],
            zorder=1,
        )
        for x, y, method in points:
            tone, mark = tones[method], mark_of(background, method, tones)
            face = tone if background == "nobg" else "white"
            axes.plot(x, y, mark, color=tone, markerfacecolor=face, markersize=7, zorder=2)
    axes.margins(0.2)


def _handles(selected: Sequence[Cell], tones: dict[str, str]) -> list[Line2D]:
    seen = dict.fromkeys((cell.key.background, cell.key.method) for cell in selected)
    return [
        Line2D(
            [],
            [],
            color=tones[method],
            marker=mark_of(background, method, tones),
            markerfacecolor=tones[method] if background == "nobg" else "white",
            linestyle="",
            label=condition_name(background, method),
        )
        for background, method in seen
    ]
