"""Points that come with a capture, from files of every usual form."""

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from mattgs_ops.capture.formats.point_cloud import read_points
from mattgs_ops.errors import InputError

XYZ = [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0)]


def write(path: Path, colours: str | None, *, text: bool) -> Path:
    fields = [(axis, "f4") for axis in "xyz"]
    rows = list(XYZ)
    if colours is not None:
        fields += [(name, colours) for name in ("red", "green", "blue")]
        bright = (255, 128, 0) if colours == "u1" else (1.0, 128 / 255, 0.0)
        rows = [(*row, *bright) for row in XYZ]
    vertex = PlyElement.describe(np.array(rows, dtype=fields), "vertex")
    PlyData([vertex], text=text).write(str(path))
    return path


@pytest.mark.parametrize("text", [True, False])
@pytest.mark.parametrize("colours", ["u1", "f4", None])
def test_ply_files_of_all_kinds_are_read(tmp_path: Path, colours: str | None, text: bool) -> None:
    points = read_points(write(tmp_path / "a.ply", colours, text=text))
    assert points.xyz.tolist() == [list(row) for row in XYZ]
    expected = [127, 127, 127] if colours is None else [255, 128, 0]
    assert points.rgb.tolist() == [expected] * 3
    assert (points.photos, len(points.seen)) == ((), 0)


def test_points_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    model = tmp_path / "model"
    model.mkdir()
    (model / "cameras.txt").write_text("1 SIMPLE_PINHOLE 640 480 500 320 240\n")
    (model / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n1 1 5 2 2 6 3 3 8\n")
    lines = ["5 1 2 3 9 9 9 0", "6 nan 2 3 9 9 9 0", "8 7 8 9 9 9 9 0"]
    (model / "points3D.txt").write_text("\n".join(lines))
    points = read_points(model)
    assert points.xyz.tolist() == [[1, 2, 3], [7, 8, 9]]
    assert points.seen.tolist() == [[0, 0], [0, 1]]


@pytest.mark.parametrize("damage", [b"", b"ply", b"solid thing", None])
def test_what_is_no_point_cloud_is_refused(tmp_path: Path, damage: bytes | None) -> None:
    path = write(tmp_path / "a.ply", "u1", text=False)
    path.write_bytes(path.read_bytes()[:-5] if damage is None else damage)
    with pytest.raises(InputError, match=r"a\.ply: expected a PLY file of points"):
        read_points(path)
