"""Grids of pictures: where each one stands, and how it is shown. Everything is placed by hand."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from reports.figures.pictures import Floats

LEFT, TOP, GAP = 0.3, 0.32, 0.03  # inches: labels at the left, titles above, between pictures
CELL = 1.55  # inches that one picture is wide
ACROSS, DOWN = 27, 23  # letters that fit above a picture, and beside one of 4 to 3


def canvas(
    rows: int,
    lanes: int,
    example: Floats,
    *,
    square: int = 0,
    width: float = CELL,
    right: float = 0,
    block: int = 0,
) -> tuple[Figure, NDArray[np.object_]]:
    """Make a grid whose cells fit the example; with ``square`` every second row is square.

    Everything is placed by hand, in inches: automatic layouts draw the figure several times.
    ``right`` inches stay free beside the grid, and room for titles above each ``block`` rows.
    """
    ratio = example.shape[0] / example.shape[1]
    heights = [width * (1.0 if square and row % 2 else ratio) for row in range(rows)]
    across = LEFT + lanes * (width + GAP) + right
    titles = -(-rows // block) if block else 1
    down = TOP * titles + sum(heights) + rows * GAP
    figure = Figure(figsize=(across, down))
    grid = np.empty((rows, lanes), dtype=object)
    below = down
    for row, height in enumerate(heights):
        titled = row % block == 0 if block else row == 0
        below -= height + (TOP if titled else 0)
        for lane in range(lanes):
            left = LEFT + lane * (width + GAP)
            box = (left / across, below / down, width / across, height / down)
            grid[row, lane] = figure.add_axes(box)
        below -= GAP
    return figure, grid


def clear(axes: NDArray[np.object_]) -> None:
    """Take away places that a shorter block leaves empty."""
    for row in axes:
        for one in row:
            one.remove()


def show(axes: Axes, picture: Floats) -> None:
    """Show a picture as it is."""
    axes.imshow(picture, vmin=0, vmax=1, interpolation="nearest")
    bare(axes)


def bare(axes: Axes) -> None:
    """Leave nothing of the axes but a thin frame."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_linewidth(0.4)
        spine.set_color("#c4cad0")


def above(axes: Axes, text: str) -> None:
    """Write above a picture."""
    axes.set_title(_lines(text, ACROSS), fontsize=7.5)


def side(axes: Axes, text: str) -> None:
    """Write at the left of a row."""
    axes.set_ylabel(_lines(text, DOWN), fontsize=6.5)


def _lines(text: str, most: int) -> str:
    return "\n".join(shortened(line, most) for line in text.split("\n"))


def shortened(text: str, most: int) -> str:
    """Leave out the middle of what is longer; names of photos begin alike and end differently."""
    if len(text) <= most:
        return text
    first = (most - 1) // 2
    return f"{text[:first]}…{text[first + 1 - most :]}"
