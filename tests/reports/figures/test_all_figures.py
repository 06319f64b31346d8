"""All figures of a report: their order, and what happens to one that cannot be drawn."""

from functools import partial
from pathlib import Path

import pytest

from mattgs_ops.errors import InputError
from reports.figures.all_figures import Part, drawn_by
from reports.figures.plots import Saved


def one(slug: str) -> Saved:
    return Saved(slug, "", Path(slug), pictorial=False)


def broken() -> Saved:
    raise InputError("splats.ply: expected a PLY file")


@pytest.mark.parametrize("processes", [1, 2])
def test_figures_keep_their_order_and_those_without_pictures_are_left_out(processes: int) -> None:
    parts: list[Part] = [
        partial(one, "a"),
        partial(list, [one("b"), one("c")]),
        partial(print, end=""),  # returns None
        partial(one, "d"),
    ]
    with drawn_by(processes, parts) as drawn:
        assert [saved.slug for saved in drawn()] == ["a", "b", "c", "d"]


@pytest.mark.parametrize("processes", [1, 2])
def test_a_figure_that_cannot_be_drawn_says_why(processes: int) -> None:
    with (
        pytest.raises(InputError, match=r"splats\.ply"),
        drawn_by(processes, [partial(one, "a"), broken]) as drawn,
    ):
        drawn()
