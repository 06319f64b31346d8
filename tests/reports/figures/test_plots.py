"""Which pictures a figure shows, and what the 3D view is given."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mattgs_ops.errors import InputError
from reports.figures import findings, photos, pictures, plots
from reports.page import splat_view
from reports.rows.schema import Cell, cells

Row = dict[str, Any]
Pictured = tuple[list[Row], Path]


def test_a_gallery_holds_what_was_scored(pictured: Pictured) -> None:
    rows, root = pictured
    found = pictures.gallery("rover", cells(rows), root)
    assert found.conditions == ["original-3dgs", "original-ours", "nobg-3dgs", "nobg-ours"]
    assert found.views == ["0000.jpg", "0004.jpg", "0008.jpg"]
    assert found.chosen() == ["0000.jpg", "0008.jpg"]
    assert found.missing == []
    white = found.truth("nobg-ours", "0000.jpg")[0, 0]
    assert white.tolist() == [1, 1, 1]


def test_missing_pictures_are_listed(pictured: Pictured, tmp_path: Path) -> None:
    rows, _ = pictured
    found = pictures.gallery("rover", cells(rows), tmp_path)
    assert len(found.missing) == 4
    assert found.views == []
    assert found.chosen() == []


def test_the_zoom_lies_where_methods_differ_most() -> None:
    one = np.zeros((40, 60, 3), np.float32)
    other = one.copy()
    other[22:28, 41:47] = 0.5  # a strong difference here, a weak one elsewhere
    other[2:8, 2:8] = 0.1
    window = pictures.widest({"nobg": [one, other]})
    assert window.side == 10
    assert window.left <= 41
    assert window.left + window.side >= 47
    assert window.top <= 22
    assert window.top + window.side >= 28


def test_the_zoom_stays_on_the_object() -> None:
    one, other = (np.zeros((48, 64, 3), np.float32) for _ in range(2))
    other[:12, :12] = 1  # the desk
    other[30:36, 40:46] = 0.2
    share = np.zeros((48, 64), np.float32)
    share[24:, 32:] = 1
    window = pictures.widest({"original": [one, other]}, share)
    assert window.left <= 40
    assert window.left + window.side >= 46
    assert window.top <= 30
    assert window.top + window.side >= 36


@pytest.mark.parametrize(
    "conditions", [["original-3dgs"], ["nobg-ours"], ["original-3dgs", "nobg-3dgs"]]
)
def test_where_no_methods_compare_the_zoom_lies_on_the_largest_error(
    pictured: Pictured, tmp_path: Path, conditions: list[str]
) -> None:
    rows, root = pictured
    mine = [row for row in rows if row["condition"] in conditions]
    found = pictures.gallery("rover", cells(mine), root)
    found.masks.clear()  # the whole frame counts
    view = found.chosen()[0]
    for condition in conditions:  # a render that is its truth but for one patch
        picture = (found.truth(condition, view) * 255).astype(np.uint8)
        picture[40:50, 60:70] = 255 - picture[40:50, 60:70]
        found.renders[condition, view] = tmp_path / f"{condition}.png"
        Image.fromarray(picture).save(found.renders[condition, view])
    window = pictures.zoom(found, view)
    assert (window.left <= 60, window.left + window.side >= 70) == (True, True)
    assert (window.top <= 40, window.top + window.side >= 50) == (True, True)
    saved = photos.comparison(found, tmp_path)
    assert saved is not None
    assert "in which render and ground truth differ most" in saved.caption


def test_methods_keep_their_colours(pictured: Pictured) -> None:
    rows, _ = pictured
    more = [*rows, rows[0] | {"method": "another"}]
    assert plots.colours(rows)["ours"] == plots.colours(more)["ours"]
    assert len(set(plots.colours(more).values())) == 4  # Ours+ has its own, run or not


def test_an_empty_field_of_a_curve_is_nan(tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text("step,psnr\n0,\n100,21.5\n")
    curve = plots.read_curve(tmp_path / "curve.csv")
    assert np.isnan(curve["psnr"][0])
    assert curve["psnr"][1] == 21.5


def test_packed_splats_unpack_to_what_was_written(pictured: Pictured) -> None:
    import base64

    from mattgs_ops.splat.files.ply import read_ply

    rows, root = pictured
    path = root / rows[0]["artifacts"]["train"] / "splats.ply"
    packed = splat_view.pack(path)
    raw = base64.b64decode(packed["data"])
    count = packed["count"]
    assert len(raw) == 16 * count
    low, high = (np.array(corner) for corner in packed["box"])
    levels = np.frombuffer(raw, "<u2", 3 * count).reshape(-1, 3)
    means = low + (high - low) * levels / 65535
    assert np.abs(means - read_ply(path).means.numpy()).max() < 1e-4


def test_the_splats_that_cover_most_are_kept() -> None:
    scales = np.log(np.array([[0.1, 0.1, 0.001], [1.0, 1.0, 0.001], [0.5, 0.5, 0.5], [9, 9, 9]]))
    alpha = np.array([0.9, 0.9, 0.9, 0.001])  # the last one is never drawn
    assert splat_view.choose(scales, alpha, 2).tolist() == [1, 2]
    assert splat_view.choose(scales, alpha, 9).tolist() == [0, 1, 2]


def test_the_orbit_turns_around_what_the_cameras_look_at(pictured: Pictured) -> None:
    _, root = pictured
    found = splat_view.orbit(root / "scene" / "rover")
    assert found["target"] == pytest.approx([0, 0, 0], abs=1e-5)
    assert found["up"] == pytest.approx([0, 0, 1], abs=1e-5)


def test_parallel_cameras_do_not_break_the_orbit() -> None:
    centres = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    axes = np.array([[0.0, 0, 1], [0, 0, 1.0]])
    assert splat_view.nearest_point(centres, axes).tolist() == [0.5, 0, 1]


def test_a_model_without_visible_splats_is_an_error(pictured: Pictured, tmp_path: Path) -> None:
    rows, root = pictured
    data = bytearray((root / rows[0]["artifacts"]["train"] / "splats.ply").read_bytes())
    start = data.index(b"end_header\n") + len(b"end_header\n")
    table = np.frombuffer(bytes(data[start:]), "<f4").reshape(-1, 62).copy()
    table[:, 54] = -20  # opacity
    (tmp_path / "dark.ply").write_bytes(bytes(data[:start]) + table.tobytes())
    with pytest.raises(InputError, match="visible splat"):
        splat_view.pack(tmp_path / "dark.ply")


@pytest.mark.parametrize(
    ("count", "sizes"), [(0, []), (1, [1]), (4, [4]), (5, [2, 3]), (12, [4] * 3)]
)
def test_many_captures_go_onto_even_sheets(count: int, sizes: list[int]) -> None:
    found = plots.sheets(list(range(count)))
    assert [len(part) for _, _, part in found] == sizes
    assert [one for _, _, part in found for one in part] == list(range(count))
    assert [slug for slug, _, _ in found] == ["", "-2", "-3"][: len(sizes)]
    assert all(("Sheet" in text) == (len(sizes) > 1) for _, text, _ in found)


def test_more_pictures_than_fit_side_by_side_stand_by_background(
    pictured: Pictured, tmp_path: Path
) -> None:
    rows, root = pictured
    twins = [row | {"method": f"m{n}", "condition": f"{row['background']}-m{n}"}
             for n in range(2) for row in rows if row["method"] == "ours"]  # fmt: skip
    few = pictures.gallery("rover", cells(rows), root)
    many = pictures.gallery("rover", cells([*rows, *twins]), root)
    shapes = []
    for name, found in (("few", few), ("many", many)):
        saved = photos.comparison(found, tmp_path / name)
        assert saved is not None
        with Image.open(saved.png) as image:
            shapes.append(image.size)
    (wide, low), (narrow, high) = shapes
    assert narrow < wide, "five lanes twice, instead of ten side by side"
    assert high > 1.9 * low


def test_a_caption_says_who_is_nearest_to_the_ground_truth(pictured: Pictured) -> None:
    rows, root = pictured
    found = pictures.gallery("rover", cells(rows), root)

    def score(condition: str, metric: str) -> float:
        (row,) = (row for row in rows if row["condition"] == condition)
        return next(v[metric] for v in row["per_view"] if v["view"] == "0004.jpg")

    def brackets(background: str) -> str:
        ours, other = (score(f"{background}-{m}", "mask_psnr") for m in ("ours", "3dgs"))
        return f"{ours:.2f} dB (3DGS {other:.2f})"

    assert findings.on_views(found, ["0004.jpg"]) == (
        "On these views Ours is nearest to the ground truth inside the mask: with its background "
        f"{brackets('original')}, without its background {brackets('nobg')}. "
    )
    error = findings.on_views(found, ["0004.jpg"], error=True)
    assert f"{score('nobg-ours', 'mask_l1'):.4f} (3DGS" in error
    assert "has the smallest mean error" in error
    assert findings.on_views(found, ["unknown.jpg"]) == ""
    better = [view | {"mask_psnr": 99.0} for view in found.rows["nobg-3dgs"]["per_view"]]
    found.rows["nobg-3dgs"] = found.rows["nobg-3dgs"] | {"per_view": better}
    told = findings.on_views(found, ["0008.jpg"])
    assert told.startswith("On these views Ours is nearest")
    assert "; 3DGS is nearest to the ground truth inside the mask: without its background" in told


def test_a_plots_caption_counts_captures(make_grid: Callable[..., list[Row]]) -> None:
    mine = cells(make_grid())
    names = ["rover", "hexapod", "lattepanda"]

    def value(cell: Cell) -> float:
        return (cell.key.method == "ours") == (cell.key.capture != "hexapod")

    told = findings.winners(mine, names, "Highest", value, "count")
    assert told == "Highest without background: Ours on 2 of 3, 3DGS on 1 of 3 captures. "
    assert findings.winners(mine, ["hexapod"], "Highest", value, "count").endswith(
        "3DGS on Hexapod. "
    )
    alone = [cell for cell in mine if cell.key.method == "ours"]
    assert findings.winners(alone, names, "Highest", value, "count") == ""
