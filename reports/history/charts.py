"""One small chart per metric of a cell, as SVG text: levels, points, steps and the gate's verdicts.

Points stand in order of time at equal distances, each with its commit, date and value as a tooltip.
Colours are classes, which the page's style sheet gives a value.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from reports.gate.findings import Verdict
from reports.history.series import ALARMS, DIGITS, Point, Series, direction_of
from reports.rows import columns

WIDTH, HEIGHT = 300, 120
LEFT, RIGHT, TOP, BOTTOM = 52, 10, 10, 20
POINT = 2.6  # radius
MARK = 5.0  # half the size of a verdict's mark
# Of the values' range that is left free above and below, and the least range that is drawn, as a
# share of the value: the same number to the bit is a line in the middle, and not a mountain range.
FREE, LEAST_RANGE = 0.12, 0.002
SETUP_COLOURS = 4
TURNS = (Verdict.BETTER, Verdict.WORSE)
DOUBTFUL = (Verdict.NOT_COMPARABLE, Verdict.INCONCLUSIVE)
DAY = "%Y-%m-%d"
MOMENT = "%Y-%m-%d %H:%M"


@dataclass(frozen=True)
class Axes:
    """Where a point and a value stand: ``order`` is a point's rank by its identity."""

    order: Mapping[int, int]
    least: float
    most: float

    @property
    def low(self) -> float:
        """The value at the bottom."""
        return self.least - self._free

    @property
    def high(self) -> float:
        """The value at the top."""
        return self.most + self._free

    @property
    def _free(self) -> float:
        drawn = max(abs(self.least), abs(self.most)) * LEAST_RANGE or 1.0
        spread = self.most - self.least
        return FREE * spread + max(0.0, drawn - spread) / 2

    def across(self, point: Point) -> float:
        """Return the point's x; one alone stands in the middle."""
        last = len(self.order) - 1
        share = self.order[id(point)] / last if last else 0.5
        return LEFT + MARK + share * (WIDTH - LEFT - RIGHT - 2 * MARK)

    def down(self, value: float) -> float:
        """Return the value's y."""
        share = (value - self.low) / (self.high - self.low)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)


def draw(series: Sequence[Series]) -> str:
    """Draw one metric of a cell; ``series`` are its setups, which share the axes."""
    points = sorted({id(p): p for one in series for p in one.points}.values(), key=_when)
    values = [value for one in series for value in one.values if value is not None]
    order = {id(point): index for index, point in enumerate(points)}
    column, place = series[0].column, Axes(order, min(values), max(values))

    parts = _axes(column, points, place)
    for index, one in enumerate(series):
        parts += _steps(one, place)
        parts.append(f'<g class="setup{index % SETUP_COLOURS}">')
        parts += [*_levels(one, place), *_points(one, place), "</g>"]
    title = escape(f"{column.label} of {series[0].cell}")
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{title}">'
        + "".join(parts)
        + "</svg>"
    )


def _when(point: Point) -> float:
    return point.when


def text_of(column: columns.Column, value: float) -> str:
    """Print a value as tables do; numbers without a unit with four digits."""
    if column.kind != DIGITS:
        return columns.text(column.kind, value)
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def _axes(column: columns.Column, points: Sequence[Point], place: Axes) -> list[str]:
    bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
    parts = [f'<path class="axis" d="M{LEFT} {TOP}V{bottom}H{right}"/>']
    texts = {text_of(column, value): value for value in (place.most, place.least)}
    for text, value in texts.items():
        where = f'x="{LEFT - 5}" y="{place.down(value) + 3:.1f}" text-anchor="end"'
        parts.append(f'<text class="tick" {where}>{escape(text)}</text>')
    first, last = (day(point) for point in (points[0], points[-1]))
    if first != last:
        parts.append(f'<text class="tick" x="{LEFT}" y="{HEIGHT - 5}">{first}</text>')
    parts.append(f'<text class="tick" x="{right}" y="{HEIGHT - 5}" text-anchor="end">{last}</text>')
    return parts


def day(point: Point) -> str:
    """Return the day of a point, in UTC."""
    return time.strftime(DAY, time.gmtime(point.when))


def moment(point: Point) -> str:
    """Return the minute of a point, in UTC."""
    return time.strftime(MOMENT, time.gmtime(point.when))


def _points(one: Series, place: Axes) -> list[str]:
    """Return the points with their tooltips and verdicts; failed runs stand on the axis."""
    parts = []
    for point, value in zip(one.points, one.values, strict=True):
        said = point.verdict(one.column.key)
        x = place.across(point)
        if value is None:
            y, words = float(HEIGHT - BOTTOM), "failed, or not measured"
            shape = f'<path class="failed" d="{_cross(x, y)}"/>'
        else:
            y, words = place.down(value), text_of(one.column, value)
            shape = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{POINT}"/>'
        words = f"{moment(point)} · {point.commit} · {words}"
        if said is not None:
            words += (
                f" · gate: {said[0]} than {said[1]}" if said[0] in TURNS else f" · gate: {said[0]}"
            )
            shape += _mark(said[0], x, y)
        parts.append(f"<g><title>{escape(words)}</title>{shape}</g>")
    return parts


def _mark(verdict: str, x: float, y: float) -> str:
    """Return the mark of a verdict beside its point; what is the same has none."""
    if verdict in ALARMS:
        return f'<path class="worse" d="M{x - MARK:.1f} {y - 13:.1f}h{2 * MARK}l{-MARK} 8z"/>'
    if verdict == Verdict.BETTER:
        return f'<path class="better" d="M{x - MARK:.1f} {y + 13:.1f}h{2 * MARK}l{-MARK} -8z"/>'
    if verdict in DOUBTFUL:
        return f'<circle class="doubtful" cx="{x:.1f}" cy="{y:.1f}" r="{MARK}"/>'
    return ""


def _cross(x: float, y: float) -> str:
    return f"M{x - 3:.1f} {y - 3:.1f}l6 6m0 -6l-6 6"


def _levels(one: Series, place: Axes) -> list[str]:
    """Return a thin line through the points, and where there are steps a thick one per level."""
    measured = one.measured()
    corners = [(place.across(one.points[i]), place.down(one.values[i] or 0.0)) for i in measured]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    parts = [f'<polyline class="run" points="{line}"/>']
    if not one.steps:
        return parts
    starts = [measured[0], *(step.first for step in one.steps)]
    heights = [one.steps[0].before, *(step.after for step in one.steps)]
    for start, end, height in zip(starts, [*starts[1:], measured[-1] + 1], heights, strict=True):
        last = max(index for index in measured if index < end)
        left, right = (place.across(one.points[i]) for i in (start, last))
        y = place.down(height)
        parts.append(f'<path class="level" d="M{left:.1f} {y:.1f}H{right:.1f}"/>')
    return parts


def _steps(one: Series, place: Axes) -> list[str]:
    """Return a dashed line where each step begins, in the colour of a loss or a gain."""
    parts = []
    for step in one.steps:
        point, sign = one.points[step.first], direction_of(one.column)
        kind = "gain" if step.change * sign > 0 else "loss"
        before, after = (text_of(one.column, value) for value in (step.before, step.after))
        words = escape(f"step at {point.commit}: {before} → {after}")
        x = place.across(point)
        line = f'<path class="step {kind}" d="M{x:.1f} {TOP}V{HEIGHT - BOTTOM}"/>'
        parts.append(f"<g><title>{words}</title>{line}</g>")
    return parts
