"""COLMAP's model files: written by COLMAP and by us, read back; damaged ones refused."""

import contextlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats.colmap_model import read_model, write_model
from mattgs_ops.capture.sparse import SparseModel
from mattgs_ops.errors import InputError
from tests.mattgs_ops.capture.conftest import SPARSE_INTRINSICS


def test_what_is_written_is_read_back(model: SparseModel, tmp_path: Path) -> None:
    write_model(model, tmp_path)
    back = read_model(tmp_path)
    assert back.cameras == model.cameras
    assert np.array_equal(back.xyz, model.xyz)
    assert np.array_equal(back.rgb, model.rgb)
    assert np.array_equal(back.error, model.error)
    assert set(back.images) == set(model.images)
    for number, image in model.images.items():
        other = back.images[number]
        assert (other.name, other.camera) == (image.name, image.camera)
        assert np.allclose(other.rotation, image.rotation, atol=1e-14)
        assert np.array_equal(other.translation, image.translation)
        assert np.array_equal(other.xy, image.xy)
        assert np.array_equal(other.points, image.points)


COLMAP_READS = """
import sys, pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
model.update_point_3d_errors()
tracks = sorted(point.track.length() for point in model.points3D.values())
print(model.num_reg_images(), model.num_points3D(), model.compute_mean_reprojection_error(), tracks)
print([model.image(n).name for n in sorted(model.reg_image_ids())])
model.write_binary(sys.argv[2])
"""


def test_colmap_reads_our_files_and_we_read_colmaps(model: SparseModel, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    theirs.mkdir()
    write_model(model, ours)
    done = subprocess.run(
        [sys.executable, "-c", COLMAP_READS, str(ours), str(theirs)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    first, names = done.stdout.splitlines()
    images, points, error, tracks = first.split(" ", 3)
    assert (int(images), int(points), tracks) == (3, 5, "[2, 2, 2, 2, 2]")
    assert float(error) < 1e-9  # key points were projected exactly: all conventions agree
    assert names == str([image.name for image in model.images.values()])
    back = read_model(theirs)
    assert np.allclose(back.xyz, model.xyz)
    number, point, xy = back.observations()
    for n, p, pixel in zip(number, point, xy, strict=True):
        image = back.images[n]
        camera = Camera(SPARSE_INTRINSICS, image.rotation, image.translation)
        assert np.allclose(camera.project(back.xyz[p][None])[0][0], pixel, atol=1e-6)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
@pytest.mark.parametrize("kept", [0, 3, 40, -3])
def test_a_file_cut_short_is_named(
    model: SparseModel, tmp_path: Path, file: str, kept: int
) -> None:
    write_model(model, tmp_path)
    data = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(data[:kept])
    with pytest.raises(InputError, match=rf"{file}: damaged or cut short"):
        read_model(tmp_path)


@pytest.mark.parametrize("count", [2**31, 2**62, 2**64 - 1])
def test_numbers_of_key_points_that_cannot_be_are_refused(
    model: SparseModel, tmp_path: Path, count: int
) -> None:
    """Such a count once sent the reader to a negative place in the file: a bare OSError."""
    write_model(model, tmp_path)
    data = bytearray((tmp_path / "images.bin").read_bytes())
    at = data.index(b"\0", data.index(b".jpg.png")) + 1  # the count follows the name
    data[at : at + 8] = count.to_bytes(8, "little")
    (tmp_path / "images.bin").write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"images\.bin: damaged or cut short"):
        read_model(tmp_path)


def test_damage_anywhere_is_an_input_error_or_another_model(
    model: SparseModel, tmp_path: Path
) -> None:
    """Overwrite eight bytes at a time, all over the files: nothing but InputError may come out."""
    write_model(model, tmp_path)
    rng = np.random.default_rng(0)
    for file in ("cameras.bin", "images.bin", "points3D.bin"):
        whole = (tmp_path / file).read_bytes()
        for at in range(0, len(whole) - 8, 7):
            damaged = whole[:at] + rng.bytes(8) + whole[at + 8 :]
            (tmp_path / file).write_bytes(damaged)
            with contextlib.suppress(InputError):
                read_model(tmp_path)
        (tmp_path / file).write_bytes(whole)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected cameras and images as \.bin or as \.txt"):
        read_model(tmp_path)


def test_a_model_without_points_is_read(model: SparseModel, tmp_path: Path) -> None:
    write_model(model, tmp_path)
    (tmp_path / "points3D.bin").unlink()
    back = read_model(tmp_path)
    assert len(back.xyz) == 0
    assert all((image.points == -1).all() for image in back.images.values())


@pytest.mark.parametrize(("code", "name"), [(10, "THIN_PRISM_FISHEYE"), (99, "with number 99")])
def test_a_camera_model_that_is_not_read_is_named(
    model: SparseModel, tmp_path: Path, code: int, name: str
) -> None:
    write_model(model, tmp_path)
    data = bytearray((tmp_path / "cameras.bin").read_bytes())
    data[12] = code  # the model's number follows the count (8 bytes) and the camera's number (4)
    (tmp_path / "cameras.bin").write_bytes(bytes(data))
    with pytest.raises(InputError, match=rf"camera model {name}: expected one of SIMPLE_PINHOLE"):
        read_model(tmp_path)


def test_an_image_without_its_camera_is_named(model: SparseModel, tmp_path: Path) -> None:
    write_model(model, tmp_path)
    data = bytearray((tmp_path / "cameras.bin").read_bytes())
    data[8] = 5
    (tmp_path / "cameras.bin").write_bytes(bytes(data))
    with pytest.raises(InputError, match="refers to camera 4, which is not there"):
        read_model(tmp_path)


@pytest.mark.parametrize(
    ("between", "end"),
    [("", "\n"), ("\n", "\n"), ("\n# another block\n", "\n"), ("", "\r\n"), ("", "\r\r\n")],
    ids=["plain", "blank", "comment", "windows", "twice"],
)
def test_blank_lines_and_line_ends_lose_no_image(tmp_path: Path, between: str, end: str) -> None:
    """As COLMAP, which reads four images of each of these."""
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 48 36 50 24 18\n")
    rows = [f"{i} 1 0 0 0 0 0 {i} 1 IMG\u2028{i}.jpg\n1.5 2.5 -1\n" for i in range(1, 5)]
    text = between.join(rows).replace("\n", end)
    (tmp_path / "images.txt").write_bytes(text.encode())
    images = read_model(tmp_path, with_points=False).images
    assert [image.name for image in images.values()] == [f"IMG\u2028{i}.jpg" for i in range(1, 5)]
    assert all(len(image.xy) == 1 for image in images.values())
