"""The file format: the layout of the original release, and what else is read or refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import plyfile
import pytest
import torch

from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.ply import read_ply, write_ply
from mattgs_ops.splat.files.ply_arrays import PROPERTIES
from mattgs_ops.splat.gaussians import Splats

MakeSplats = Callable[[int, int], Splats]
LIST_PROPERTY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    b"property list char int a\nend_header\n\0"
)


@pytest.fixture
def splats(make_splats: MakeSplats) -> Splats:
    made = make_splats(7, 3)
    made.sh_rest.normal_(generator=torch.Generator().manual_seed(0))
    return made


def same(first: Splats, second: Splats) -> bool:
    pairs = zip(first.items(), second.items(), strict=True)
    return all(torch.equal(a, b) for (_, a), (_, b) in pairs)


def test_what_is_written_reads_back_to_the_bit(splats: Splats, tmp_path: Path) -> None:
    write_ply(splats, tmp_path / "a.ply")
    found = read_ply(tmp_path / "a.ply")
    found.check()
    assert same(found, splats)
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]


def test_the_header_is_the_originals(splats: Splats, tmp_path: Path) -> None:
    write_ply(splats, tmp_path / "a.ply")
    names = ["x", "y", "z", "nx", "ny", "nz"]
    names += [f"f_dc_{i}" for i in range(3)] + [f"f_rest_{i}" for i in range(45)]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 7\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    data = (tmp_path / "a.ply").read_bytes()
    assert data.startswith(header.encode())
    assert len(data) == len(header) + 7 * 62 * 4


def test_every_value_is_in_its_place(splats: Splats, tmp_path: Path) -> None:
    write_ply(splats, tmp_path / "a.ply")
    vertex = plyfile.PlyData.read(tmp_path / "a.ply")["vertex"]
    np.testing.assert_array_equal(vertex["y"], splats.means[:, 1])
    np.testing.assert_array_equal(vertex["ny"], np.zeros(7))
    np.testing.assert_array_equal(vertex["opacity"], splats.opacity_logits)
    np.testing.assert_array_equal(vertex["scale_2"], splats.log_scales[:, 2])
    np.testing.assert_array_equal(vertex["rot_0"], splats.quaternions[:, 0])
    np.testing.assert_array_equal(vertex["f_dc_2"], splats.sh_dc[:, 2])
    for channel in range(3):  # channel-major: red's 15 first
        for k in range(15):
            column = vertex[f"f_rest_{channel * 15 + k}"]
            np.testing.assert_array_equal(column, splats.sh_rest[:, k, channel])


def write_other(path: Path, columns: dict[str, np.ndarray], **how: object) -> None:
    kinds = [(name, values.dtype) for name, values in columns.items()]
    table = np.empty(len(next(iter(columns.values()))), kinds)
    for name, values in columns.items():
        table[name] = values
    element = plyfile.PlyElement.describe(table, "vertex")
    plyfile.PlyData([element], **how).write(path)


def columns_of(splats: Splats, tmp_path: Path) -> dict[str, np.ndarray]:
    write_ply(splats, tmp_path / "own.ply")
    vertex = plyfile.PlyData.read(tmp_path / "own.ply")["vertex"]
    return {name: np.array(vertex[name]) for name in PROPERTIES}


def test_other_trainers_files_read_too(splats: Splats, tmp_path: Path) -> None:
    """Another order, no normals, SH of degree 1, a comment."""
    columns = columns_of(splats, tmp_path)
    kept = {k: v for k, v in columns.items() if not k.startswith(("n", "f_rest"))}
    kept |= {
        f"f_rest_{c * 3 + k}": columns[f"f_rest_{c * 15 + k}"] for c in range(3) for k in (0, 1, 2)
    }
    turned = dict(reversed(kept.items()))
    write_other(tmp_path / "b.ply", turned, comments=["by another trainer"])
    found = read_ply(tmp_path / "b.ply")
    splats.sh_rest[:, 3:] = 0
    assert same(found, splats)


def test_comments_may_be_of_any_letters(splats: Splats, tmp_path: Path) -> None:
    """Trainers write names and paths there."""
    write_ply(splats, tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    head, end, rest = data.partition(b"end_header")
    for end_of_line in (b"\n", b"\r\n"):
        lines = [*head.splitlines(), "comment scene: K\u00e4fer".encode()]
        text = end_of_line.join([*lines, end])
        (tmp_path / "b.ply").write_bytes(text + end_of_line + rest.removeprefix(b"\n"))
        assert same(read_ply(tmp_path / "b.ply"), splats)


@pytest.mark.parametrize("start", [b"ply\ncomment a\nformat", b"ply\r\nformat"])
def test_an_ascii_file_is_called_one(tmp_path: Path, start: bytes) -> None:
    (tmp_path / "a.ply").write_bytes(start + b" ascii 1.0\nelement vertex 0\nend_header\n")
    with pytest.raises(InputError, match="expected a binary PLY file, found one in ascii"):
        read_ply(tmp_path / "a.ply")


def test_no_splats_at_all_is_a_file_like_any_other(tmp_path: Path) -> None:
    write_ply(Splats.zeros(0), tmp_path / "a.ply")
    assert len(read_ply(tmp_path / "a.ply")) == 0


def test_a_point_cloud_is_refused_by_what_it_lacks(tmp_path: Path) -> None:
    xyz = {name: np.zeros(3, np.float32) for name in "xyz"}
    write_other(tmp_path / "a.ply", xyz)
    with pytest.raises(InputError, match=r"a\.ply.*`f_dc_0`"):
        read_ply(tmp_path / "a.ply")


def test_other_byte_orders_and_number_types_read_too(splats: Splats, tmp_path: Path) -> None:
    columns = columns_of(splats, tmp_path)
    write_other(tmp_path / "big.ply", columns, byte_order=">")
    columns["opacity"] = columns["opacity"].astype(np.float64)
    write_other(tmp_path / "double.ply", columns)
    for name in ("big", "double"):
        assert same(read_ply(tmp_path / f"{name}.ply"), splats)


def test_text_is_refused(splats: Splats, tmp_path: Path) -> None:
    write_other(tmp_path / "text.ply", columns_of(splats, tmp_path), text=True)
    with pytest.raises(InputError, match=r"text\.ply: expected a binary PLY file"):
        read_ply(tmp_path / "text.ply")


@pytest.mark.parametrize("change", [-1, 1, -248])
def test_a_file_of_the_wrong_length_is_refused(splats: Splats, tmp_path: Path, change: int) -> None:
    write_ply(splats, tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    (tmp_path / "a.ply").write_bytes(data[:change] if change < 0 else data + b"\0" * change)
    with pytest.raises(InputError, match=r"a\.ply: expected"):
        read_ply(tmp_path / "a.ply")


def test_a_header_that_claims_more_than_there_is_takes_no_memory(
    splats: Splats, tmp_path: Path
) -> None:
    write_ply(splats, tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    claimed = data.replace(b"element vertex 7\n", b"element vertex 7000000000000\n")
    (tmp_path / "a.ply").write_bytes(claimed)
    with pytest.raises(InputError, match=r"a\.ply: expected"):
        read_ply(tmp_path / "a.ply")


def test_nan_is_refused_by_field_and_vertex(splats: Splats, tmp_path: Path) -> None:
    splats.log_scales[4, 1] = float("nan")
    write_ply(splats, tmp_path / "a.ply")
    with pytest.raises(InputError, match="`log_scales` of vertex 4"):
        read_ply(tmp_path / "a.ply")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"PNG",
        b"ply\n",
        b"ply\nend_header\n",
        b"ply\nformat binary_little_endian 1.0\nend_header\n",
        b"ply\nformat binary_little_endian 1.0\nelement face 3\nend_header\n",
        b"ply\nformat binary_little_endian 1.0\nelement vertex -3\nend_header\n",
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int a\nend_header\n0\n",
        LIST_PROPERTY,
    ],
)
def test_anything_else_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.ply: expected"):
        read_ply(tmp_path / "a.ply")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.ply"):
        read_ply(tmp_path / "none.ply")


@pytest.mark.parametrize(("old", "new"), [("f_rest_44", "f_rest_99"), ("nx", "x")])
def test_odd_property_names_are_refused(splats: Splats, tmp_path: Path, old: str, new: str) -> None:
    write_ply(splats, tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    changed = data.replace(f"float {old}\n".encode(), f"float {new}\n".encode())
    (tmp_path / "a.ply").write_bytes(changed)
    with pytest.raises(InputError, match=r"a\.ply"):
        read_ply(tmp_path / "a.ply")
