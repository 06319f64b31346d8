"""How conditions look: colours, dashes, marks, legends and headings; and whom captions credit."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mattgs_ops.capture.sparse import OBJECT_SHARE
from reports.figures import findings, photos, picture_grid, plots, trade_off
from reports.figures.pictures import Gallery
from reports.rows.schema import cells
from tests.reports.conftest import cell_row

Row = dict[str, Any]
Pictured = tuple[list[Row], Path]
MANY = tuple(f"part-{number}" for number in range(18))


def test_own_colours_are_nobody_elses() -> None:
    tones = plots.colours([cell_row("rover", "nobg", method) for method in (*MANY, "3dgs")])
    own = {tones[method] for method in plots.OWN_COLOUR}
    assert len(own) == 3
    assert own.isdisjoint(tones[method] for method in MANY)


def test_lines_of_one_colour_differ_in_their_dashes() -> None:
    tones = plots.colours([cell_row("rover", "nobg", method) for method in MANY])
    looks = {
        (tones[method], plots.dashes_of(background, method, tones))
        for method in MANY
        for background in ("original", "nobg")
    }
    assert len(looks) == 2 * len(MANY)
    assert plots.dashes_of("original", "3dgs", tones) == "--"
    assert plots.dashes_of("nobg", "ours", tones) == "-"


def test_a_figure_grows_by_the_rows_of_its_legend() -> None:
    heights = []
    for count in (4, 40):
        figure = Figure(figsize=(5, 4))
        figure.subplots()
        plots.legend(figure, [Line2D([], [], label=f"condition {n}") for n in range(count)])
        heights.append(figure.get_figheight())
    rows = -(-40 // 3)
    assert heights[0] == 4
    assert heights[1] == pytest.approx(4 + (rows - plots.LEGEND_ROWS) * plots.LEGEND_HEIGHT)


def test_long_names_stand_on_several_lines() -> None:
    axes = Figure().subplots()
    plots.headed(axes, "a capture whose name is longer than its column is wide")
    lines = axes.get_title().splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= plots.TITLE_LETTERS


def curves_of(rows: list[Row], root: Path, folder: Path) -> str:
    with plots.style():
        (saved,) = plots.training_curves(rows, root, folder)
    return saved.caption


def test_the_caption_of_curves_names_the_methods_that_weight_their_loss(
    pictured: Pictured, tmp_path: Path
) -> None:
    rows, root = pictured
    plain = [row for row in rows if row["method"] == "3dgs"]
    told = curves_of(rows, root, tmp_path)
    assert "The loss of Ours is on a weighted scale and does not compare with that of oth" in told
    renamed = [row | {"method": "ours+"} if row["method"] == "ours" else row for row in rows]
    assert "The loss of Ours+ is on" in curves_of(renamed, root, tmp_path)
    assert "Loss and PSNR compare on one background." in curves_of(plain, root, tmp_path)
    named = [row | {"method": "mine"} if row["method"] == "ours" else row for row in rows]
    assert "of methods of the benchmark's own that weight it is" in curves_of(named, root, tmp_path)


def test_the_legend_of_curves_has_every_columns_methods(
    pictured: Pictured, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    handles: list[Line2D] = []
    monkeypatch.setattr(plots, "legend", lambda _, found: handles.extend(found))
    rows, root = pictured
    lacking = [row for row in rows if row["method"] == "3dgs"]
    curves_of([*lacking, *(row | {"capture": "zebra"} for row in rows)], root, tmp_path)
    assert len({str(handle.get_label()) for handle in handles}) == len(handles) == 4


def test_the_axes_of_curves_hold_numbers(
    pictured: Pictured, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without mathematical text, which would stand there as it is written."""
    drawn: list[Figure] = []
    monkeypatch.setattr(plots, "legend", lambda figure, _: drawn.append(figure))
    rows, root = pictured
    curves_of(rows, root, tmp_path)
    (figure,) = drawn
    figure.draw_without_rendering()
    texts = [
        label.get_text()
        for axes in figure.axes
        for minor in (False, True)
        for label in (*axes.get_xticklabels(minor=minor), *axes.get_yticklabels(minor=minor))
    ]
    assert any(texts)
    assert not [text for text in texts if "$" in text]


def test_a_dot_in_a_name_begins_no_suffix(tmp_path: Path) -> None:
    saved = [
        plots.save(Figure(), tmp_path, f"figure-masks-cup.{name}", "") for name in ("v1", "v2")
    ]
    assert [one.png.name for one in saved] == ["figure-masks-cup.v1.png", "figure-masks-cup.v2.png"]
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".pdf", ".pdf", ".png", ".png"]


def test_a_name_that_is_too_long_keeps_both_ends() -> None:
    name = "IMG_2026-11-28_10-15-03_0001.jpg"
    assert picture_grid.shortened(name, 23) == "IMG_2026-11…03_0001.jpg"
    assert picture_grid.shortened("0001.jpg", 8) == "0001.jpg"
    for length in (2, 3, 10, 23):
        assert len(picture_grid.shortened("a" * 60, length)) == length
    axes = Figure().subplots()
    picture_grid.above(axes, f"Original\n{'m' * 60}")
    first, second = axes.get_title().split("\n")
    assert (first, len(second)) == ("Original", picture_grid.ACROSS), "each line for itself"


def test_a_narrow_figure_grows_to_its_longest_name() -> None:
    with plots.style():
        figure = Figure(figsize=(3, 3))
        figure.subplots()
        name = "weighted-by-the-residual-of-the-last-hundred-steps"
        plots.legend(figure, [Line2D([], [], label=f"{name}, no background")])
        figure.draw_without_rendering()
    (box,) = (one.get_window_extent() for one in figure.legends)
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.x1


def test_what_prints_alike_is_equal(make_grid: Callable[..., list[Row]]) -> None:
    mine = cells(make_grid(methods=("3dgs", "ours", "ours+")))
    names = ["rover", "hexapod", "lattepanda"]
    scores = {
        "rover": {"3dgs": 25.001, "ours": 25.0, "ours+": 25.004},
        "hexapod": {"3dgs": 24.0, "ours": 25.001, "ours+": 25.0},
        "lattepanda": {"3dgs": 24.0, "ours": 25.0, "ours+": 25.1},
    }
    told = findings.winners(
        mine, names, "Highest", lambda cell: scores[cell.key.capture][cell.key.method], "db"
    )
    assert told == (
        "Highest without background: equal on 1 of 3, Ours and Ours+ equal on 1 of 3, Ours+ on 1 "
        "of 3 captures. "
    )


@pytest.mark.parametrize(
    ("psnr", "says"),
    [
        ((25.001, 25.0, 25.004), "3DGS, Ours and Ours+ are equally near to the ground truth"),
        ((24.0, 25.001, 25.0), "Ours and Ours+ are nearest to the ground truth"),
        ((24.0, 25.0, 25.1), "Ours+ is nearest to the ground truth"),
    ],
)
def test_nobody_is_nearer_by_what_is_not_printed(psnr: tuple[float, ...], says: str) -> None:
    found = Gallery("rover")
    for method, score in zip(("3dgs", "ours", "ours+"), psnr, strict=True):
        row = cell_row("rover", "nobg", method)
        row["per_view"] = [view | {"mask_psnr": score} for view in row["per_view"]]
        found.rows[row["condition"]] = row
        found.renders[row["condition"], "0000.jpg"] = Path("unread")
    assert findings.on_views(found, ["0000.jpg"]).startswith(f"On these views {says} inside")


def test_points_are_the_objects_by_the_rule_of_training(pictured: Pictured, tmp_path: Path) -> None:
    from mattgs_ops.capture.scene import Scene

    rows, root = pictured
    (saved,) = photos.masked_sfm([("rover", rows[0])], root, tmp_path)
    share = Scene.load(root / rows[0]["artifacts"]["scene"]).points().object_share
    printed = f"({(share >= OBJECT_SHARE).mean() * 100:.0f} % of Rover's)"
    assert printed in saved.caption
    assert "80 % or more of the views that see them" in saved.caption


def test_the_marks_of_a_figure_of_points_differ(
    make_grid: Callable[..., list[Row]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    handles: list[Line2D] = []
    monkeypatch.setattr(trade_off, "legend", lambda _, found: handles.extend(found))
    trade_off.trade_offs(make_grid(captures=("rover",), methods=MANY), tmp_path)
    looks = {(h.get_marker(), h.get_color(), h.get_markerfacecolor()) for h in handles}
    assert len(looks) == len(handles) == 2 * len(MANY)
