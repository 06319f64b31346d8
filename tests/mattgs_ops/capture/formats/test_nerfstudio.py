"""Cameras in JSON, nerfstudio's and NeRF's: written by hand, read back."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mattgs_ops.capture.camera import rotation_of
from mattgs_ops.capture.formats.nerfstudio import read_nerfstudio
from mattgs_ops.errors import InputError
from tests.reference.opengl import to_opengl

RNG = np.random.default_rng(5)
QUATERNIONS = RNG.normal(size=(3, 4))
TRANSLATIONS = RNG.normal(size=(3, 3))
NAMES = ("a.jpg", "b.jpg", "c.jpg")


def photos_in(folder: Path, names: tuple[str, ...] = NAMES) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_bytes(b"")
    return folder


def transforms(**changes: Any) -> dict[str, Any]:
    frames = []
    for name, q, t in zip(NAMES, QUATERNIONS, TRANSLATIONS, strict=True):
        matrix = to_opengl(rotation_of(q), t)
        frames.append({"file_path": f"images/{name}", "transform_matrix": matrix.tolist()})
    base = {"w": 640, "h": 480, "fl_x": 500.0, "fl_y": 510.0, "cx": 321.0, "cy": 239.0}
    return base | {"frames": frames} | changes


def write_transforms(folder: Path, data: object) -> Path:
    photos_in(folder / "images")
    (folder / "transforms.json").write_text(json.dumps(data))
    return folder


def test_nerfstudio_poses_come_out_in_our_convention(tmp_path: Path) -> None:
    data = transforms(camera_model="PINHOLE", k1=9)
    photos = read_nerfstudio(write_transforms(tmp_path, data)).photos
    for photo, q, t in zip(photos, QUATERNIONS, TRANSLATIONS, strict=True):
        np.testing.assert_allclose(photo.rotation, rotation_of(q), atol=1e-12)
        np.testing.assert_allclose(photo.translation, t, atol=1e-12)
        assert photo.lens.is_pinhole  # PINHOLE means that coefficients do not apply
    i = photos[0].lens.intrinsics
    assert (i.width, i.height, i.fx, i.fy, i.cx, i.cy) == (640, 480, 500, 510, 321, 239)


def test_nerfstudio_per_frame_intrinsics_go_before_the_common_ones(tmp_path: Path) -> None:
    data = transforms(camera_model="OPENCV", k1=0.1, p2=0.01)
    data["frames"][1] |= {"fl_x": 700.0, "k1": 0.3, "mask_path": "images/a.jpg"}
    photos = read_nerfstudio(write_transforms(tmp_path, data)).photos
    assert photos[0].lens.coefficients == (0.1, 0, 0, 0.01, 0, 0, 0, 0)
    assert photos[1].lens.coefficients == (0.3, 0, 0, 0.01, 0, 0, 0, 0)
    assert photos[1].lens.intrinsics.fx == 700
    assert photos[1].mask == tmp_path / "images" / "a.jpg"
    assert photos[0].mask is None


def test_nerf_synthetic_forms_are_read(tmp_path: Path) -> None:
    """``camera_angle_x`` instead of a focal length, and paths without a suffix."""
    data = transforms(camera_angle_x=2 * np.arctan(0.5))
    for key in ("fl_x", "fl_y", "cx", "cy"):
        del data[key]
    data["frames"] = data["frames"][:1]
    data["frames"][0]["file_path"] = "./images/r_0"
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "r_0.png").write_bytes(b"")
    photo = read_nerfstudio(write_transforms(tmp_path, data)).photos[0]
    i = photo.lens.intrinsics
    assert photo.photo.name == "r_0.png"
    assert (i.fx, i.fy, i.cx, i.cy) == pytest.approx((640, 640, 320, 240))


def broken_frame(**changes: Any) -> dict[str, Any]:
    data = transforms()
    data["frames"][1] |= changes
    return data


SCALED = (2 * np.eye(4)).tolist()
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([], "expected a list of objects called `frames`"),
        ({"frames": [1]}, "expected a list of objects called `frames`"),
        (broken_frame(file_path="images/z.jpg"), r"frame 1: .*z\.jpg is missing"),
        (broken_frame(file_path=None), "frame 1: expected `file_path`"),
        (broken_frame(transform_matrix=[[1, 2], [3]]), "frame 1 .*must be 4x4"),
        (broken_frame(transform_matrix=SCALED), "no rigid motion"),
        (broken_frame(transform_matrix=MIRRORED), "no rigid motion"),
        (broken_frame(transform_matrix=[["x"] * 4] * 4), "must hold numbers"),
        (broken_frame(camera_model="EQUIRECTANGULAR"), "expected one of PINHOLE"),
        (broken_frame(k4=0.1), "are not read"),
        (broken_frame(fl_x="wide"), "must be numbers"),
        (broken_frame(fl_x=-1.0), "expected positive"),
        (broken_frame(file_path="images/a.jpg"), r"a\.jpg listed more than once"),
    ],
)
def test_what_is_wrong_in_transforms_is_named(tmp_path: Path, data: object, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        read_nerfstudio(write_transforms(tmp_path, data))
    assert "transforms.json" in str(error.value)


def test_missing_intrinsics_are_named(tmp_path: Path) -> None:
    data = transforms()
    del data["w"]
    with pytest.raises(InputError, match="intrinsics incomplete: 'w' is missing"):
        read_nerfstudio(write_transforms(tmp_path, data))


def test_text_that_is_no_json_is_refused(tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_text("{")
    with pytest.raises(InputError, match="expected a readable JSON file"):
        read_nerfstudio(tmp_path)


def test_a_lens_of_every_family_is_read(tmp_path: Path) -> None:
    data = transforms(camera_model="OPENCV_FISHEYE", k1=0.1, k2=0.2, k3=0.3, k4=0.4)
    lens = read_nerfstudio(write_transforms(tmp_path, data)).photos[0].lens
    assert (lens.fisheye, lens.coefficients) == (True, (0.1, 0.2, 0.3, 0.4))
    data = transforms(is_fisheye=True, k1=0.1, k2=0.2, k3=0.3, k4=0.4)  # as instant-ngp says it
    lens = read_nerfstudio(write_transforms(tmp_path, data)).photos[0].lens
    assert (lens.fisheye, lens.coefficients) == (True, (0.1, 0.2, 0.3, 0.4))
    data = transforms(camera_model="FULL_OPENCV", k1=0.1, p2=0.2, k3=0.3, k6=0.4)
    lens = read_nerfstudio(write_transforms(tmp_path, data)).photos[0].lens
    assert (lens.fisheye, lens.coefficients) == (False, (0.1, 0, 0, 0.2, 0.3, 0, 0, 0.4))


@pytest.mark.parametrize(
    ("lists", "split", "left_out"),
    [
        ({}, {}, []),
        ({"test_filenames": ["images/b.jpg"]}, {"a": "train", "b": "test", "c": "train"}, []),
        ({"train_filenames": ["images/b.jpg"]}, {"a": "test", "b": "train", "c": "test"}, []),
        (
            {
                "train_filenames": ["./images/a.jpg"],
                "val_filenames": ["images/b.jpg"],
                "test_filenames": ["images/c.jpg"],
            },
            {"a": "train", "c": "test"},
            ["b.jpg"],
        ),
        # what nerfstudio writes where there is no test part
        (
            {
                "train_filenames": ["images/a.jpg", "images/c.jpg"],
                "val_filenames": ["images/b.jpg"],
                "test_filenames": [],
            },
            {"a": "train", "b": "test", "c": "train"},
            [],
        ),
    ],
)
def test_a_split_that_comes_with_the_frames_is_kept(
    tmp_path: Path, lists: dict[str, list[str]], split: dict[str, str], left_out: list[str]
) -> None:
    found = read_nerfstudio(write_transforms(tmp_path, transforms(**lists)))
    assert {path.stem: part for path, part in found.split.items()} == split
    assert [path.name for path in found.left_out] == left_out
    assert [p.photo.name for p in found.photos] == [n for n in NAMES if n not in left_out]


@pytest.mark.parametrize(
    ("lists", "message"),
    [
        ({"test_filenames": ["images/z.jpg"]}, r"lists images/z\.jpg: no such photos"),
        ({"test_filenames": "images/a.jpg"}, "expected a list of file names"),
        (
            {"train_filenames": ["images/a.jpg"], "test_filenames": ["images/a.jpg"]},
            r"a\.jpg listed for training and for testing",
        ),
        ({"test_filenames": [f"images/{name}" for name in NAMES]}, "leaves no training photos"),
    ],
)
def test_a_split_that_fits_no_photos_is_refused(
    tmp_path: Path, lists: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_nerfstudio(write_transforms(tmp_path, transforms(**lists)))


def write_nerf(folder: Path, parts: dict[str, int]) -> Path:
    """NeRF's own layout: no sizes, no suffixes, one file a part, the same names in each."""
    for part, count in parts.items():
        (folder / part).mkdir(parents=True)
        frames = []
        for index in range(count):
            Image.new("RGB", (40, 30)).save(folder / part / f"r_{index}.png")
            matrix = np.eye(4)
            matrix[0, 3] = index
            frames.append({"file_path": f"./{part}/r_{index}", "transform_matrix": matrix.tolist()})
        data = {"camera_angle_x": 2 * np.arctan(0.5), "frames": frames}
        (folder / f"transforms_{part}.json").write_text(json.dumps(data))
    return folder


@pytest.mark.parametrize("parts", [{"train": 4, "val": 2, "test": 3}, {"train": 4, "val": 3}])
def test_nerfs_own_layout_keeps_its_split(tmp_path: Path, parts: dict[str, int]) -> None:
    found = read_nerfstudio(write_nerf(tmp_path, parts))
    held_out = "test" if "test" in parts else "val"
    names = [p.photo.relative_to(tmp_path).as_posix() for p in found.photos]
    assert sorted(names) == sorted(
        f"{p}/r_{i}.png" for p in ("train", held_out) for i in range(parts[p])
    )
    assert {p.parent.name: s for p, s in found.split.items()} == {
        "train": "train",
        held_out: "test",
    }
    i = found.photos[0].lens.intrinsics
    assert (i.width, i.height, i.fx, i.fy, i.cx, i.cy) == pytest.approx((40, 30, 40, 40, 20, 15))


def test_nerfs_layout_without_held_out_photos_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected transforms_test\.json beside it"):
        read_nerfstudio(write_nerf(tmp_path, {"train": 4}))


def test_points_are_named_and_must_be_there(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path, transforms(ply_file_path="sparse_pc.ply"))
    with pytest.raises(InputError, match=r"sparse_pc\.ply is missing"):
        read_nerfstudio(folder)
    (folder / "sparse_pc.ply").write_bytes(b"ply")
    assert read_nerfstudio(folder).points == folder / "sparse_pc.ply"


@pytest.mark.parametrize("name", ["../secret.jpg", "images/../../secret.jpg", "/etc/hostname"])
@pytest.mark.parametrize("key", ["file_path", "mask_path", "ply_file_path"])
def test_names_that_lead_out_of_the_capture_are_refused(
    tmp_path: Path, key: str, name: str
) -> None:
    (tmp_path / "secret.jpg").write_bytes(b"not yours")
    data = transforms(**{key: name}) if key == "ply_file_path" else broken_frame(**{key: name})
    with pytest.raises(InputError, match="leads out of"):
        read_nerfstudio(write_transforms(tmp_path / "capture", data))


def without_focal(**changes: Any) -> dict[str, Any]:
    return {k: v for k, v in transforms(**changes).items() if k not in ("fl_x", "fl_y")}


def test_each_direction_has_its_field_of_view(tmp_path: Path) -> None:
    data = without_focal(camera_angle_x=2 * np.arctan(0.5), camera_angle_y=2 * np.arctan(0.25))
    i = read_nerfstudio(write_transforms(tmp_path, data)).photos[0].lens.intrinsics
    assert (i.fx, i.fy) == pytest.approx((640, 960))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera_angle_x": 0}, "`camera_angle_x`: expected radians from 0 to 3.1, found 0"),
        ({"camera_angle_x": 3.1415}, "`camera_angle_x`: expected radians"),
        ({"camera_angle_x": 1.0, "camera_angle_y": -1}, "`camera_angle_y`: expected radians"),
        ({"camera_angle_x": 1.0, "w": float("inf")}, "intrinsics must be numbers"),
        ({"camera_angle_x": 10**400}, "intrinsics must be numbers"),
    ],
)
def test_numbers_that_make_no_lens_are_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_nerfstudio(write_transforms(tmp_path, without_focal(**changes)))


def test_paths_as_windows_writes_them_are_found(tmp_path: Path) -> None:
    found = read_nerfstudio(write_transforms(tmp_path, broken_frame(file_path="images\\b.jpg")))
    assert found.photos[1].photo == tmp_path / "images" / "b.jpg"
    with pytest.raises(InputError, match="leads out of"):
        read_nerfstudio(write_transforms(tmp_path, broken_frame(file_path="..\\..\\b.jpg")))
