"""Logarithmic axes: plain numbers, two at least."""

import pytest
from matplotlib.figure import Figure

from reports.figures.plots import style
from reports.figures.scales import plain_numbers


@pytest.mark.parametrize(
    ("low", "high"),
    [
        (2.1, 4.9),
        (11, 19),
        (21, 29),
        (0.52, 0.97),
        (30, 47),
        (2.01, 10.1),
        (1, 80),
        (0.004, 0.9),
        (3e-5, 4e-5),
    ],
)
def test_an_axis_has_two_labels_at_least(low: float, high: float) -> None:
    with style():
        figure = Figure()
        axes = figure.subplots()
        axes.plot([0, 1], [low, high])
        axes.set_yscale("log")
        plain_numbers(axes.yaxis)
        figure.draw_without_rendering()
        ends = axes.get_ylim()
        shown = [
            label.get_text()
            for tick, label in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)
            if ends[0] <= tick <= ends[1]
        ]
        minor = [label.get_text() for label in axes.get_yticklabels(minor=True)]
    assert len(set(shown)) >= 2
    assert all(float(text.replace(",", "")) > 0 for text in shown), "numbers, no markup"
    assert not any(minor)
