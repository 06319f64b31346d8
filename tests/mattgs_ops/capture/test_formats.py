"""Cameras of nerfstudio and COLMAP: written by the real tools or by hand, read back."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mattgs_ops.capture.camera import to_opengl
from mattgs_ops.capture.formats import raise_all, read_colmap, read_nerfstudio, rotation_matrix
from mattgs_ops.errors import InputError

RNG = np.random.default_rng(5)
QUATERNIONS = RNG.normal(size=(3, 4))
TRANSLATIONS = RNG.normal(size=(3, 3))
NAMES = ("a.jpg", "b.jpg", "c.jpg")
# parameters of each COLMAP model, and what they mean: fx fy cx cy k1 k2 p1 p2
MODELS = {
    "SIMPLE_PINHOLE": ([500, 320, 240], [500, 500, 320, 240, 0, 0, 0, 0]),
    "PINHOLE": ([500, 510, 320, 240], [500, 510, 320, 240, 0, 0, 0, 0]),
    "SIMPLE_RADIAL": ([500, 320, 240, 0.1], [500, 500, 320, 240, 0.1, 0, 0, 0]),
    "RADIAL": ([500, 320, 240, 0.1, -0.2], [500, 500, 320, 240, 0.1, -0.2, 0, 0]),
    "OPENCV": (
        [500, 510, 320, 240, 0.1, -0.2, 0.01, 0.02],
        [500, 510, 320, 240, 0.1, -0.2, 0.01, 0.02],
    ),
}

# pycolmap has crashed processes that go on with other image libraries: it writes in its own
WRITE_MODEL = """
import json, sys, pycolmap
job = json.loads(sys.argv[1])
model = pycolmap.Reconstruction()
model.add_camera_with_trivial_rig(
    pycolmap.Camera(camera_id=7, model=job["model"], width=640, height=480, params=job["params"])
)
for i, (name, q, t) in enumerate(zip(job["names"], job["quaternions"], job["translations"])):
    pose = pycolmap.Rigid3d(pycolmap.Rotation3d(q[1:] + q[:1]), t)
    image = pycolmap.Image(name=name, camera_id=7, image_id=i + 1)
    image.points2D = pycolmap.Point2DList([pycolmap.Point2D([1.0, 2.0])] * (i % 2))
    model.add_image_with_trivial_frame(image, pose)
model.write_text(job["text"]); model.write_binary(job["binary"])
"""


def photos_in(folder: Path, names: tuple[str, ...] = NAMES) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_bytes(b"")
    return folder


def write_with_colmap(folder: Path, model: str) -> None:
    unit = QUATERNIONS / np.linalg.norm(QUATERNIONS, axis=1, keepdims=True)
    job = {
        "model": model,
        "params": [float(p) for p in MODELS[model][0]],
        "names": NAMES,
        "quaternions": unit.tolist(),
        "translations": TRANSLATIONS.tolist(),
        "text": str(folder / "text"),
        "binary": str(folder / "binary"),
    }
    for kind in ("text", "binary"):
        (folder / kind).mkdir()
    subprocess.run([sys.executable, "-c", WRITE_MODEL, json.dumps(job)], check=True)


@pytest.mark.parametrize("model", ["SIMPLE_RADIAL", "OPENCV"])
def test_models_written_by_colmap_are_read(tmp_path: Path, model: str) -> None:
    write_with_colmap(tmp_path, model)
    images = photos_in(tmp_path / "images")
    for kind in ("text", "binary"):
        photos = read_colmap(tmp_path / kind, images)
        assert [p.photo.name for p in photos] == list(NAMES)
        for photo, q, t in zip(photos, QUATERNIONS, TRANSLATIONS, strict=True):
            np.testing.assert_allclose(photo.rotation, rotation_matrix(q), atol=1e-12)
            np.testing.assert_allclose(photo.translation, t, atol=1e-12)
            i = photo.lens.intrinsics
            assert (i.width, i.height) == (640, 480)
            found = [i.fx, i.fy, i.cx, i.cy, *photo.lens.coefficients]
            np.testing.assert_allclose(found, [*MODELS[model][1], 0])


def write_text_model(folder: Path, camera: str, images: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(f"# cameras\n{camera}\n")
    (folder / "images.txt").write_text(f"# images\n# two lines each\n{images}")
    return folder


@pytest.mark.parametrize("model", MODELS)
def test_every_camera_model_means_what_colmap_means(tmp_path: Path, model: str) -> None:
    given, meant = MODELS[model]
    camera = f"1 {model} 640 480 {' '.join(map(str, given))}"
    text = "".join(f"{i} 1 0 0 0 0 0 {i} 1 {name}\n\n" for i, name in enumerate(NAMES))
    folder = write_text_model(tmp_path / "model", camera, text)
    photos = read_colmap(folder, photos_in(tmp_path / "images"))
    i = photos[2].lens.intrinsics
    assert [i.fx, i.fy, i.cx, i.cy, *photos[2].lens.coefficients[:4]] == meant
    assert photos[2].translation.tolist() == [0, 0, 2]


def test_unread_colmap_models_are_named(tmp_path: Path) -> None:
    folder = write_text_model(tmp_path / "m", "1 OPENCV_FISHEYE 640 480 1 1 1 1 0 0 0 0", "")
    with pytest.raises(InputError, match="OPENCV_FISHEYE: expected one of SIMPLE_PINHOLE"):
        read_colmap(folder, tmp_path)


def test_a_registered_photo_that_is_missing_is_named(tmp_path: Path) -> None:
    text = "".join(f"{i} 1 0 0 0 0 0 {i} 1 {name}\n1 2 -1\n" for i, name in enumerate(NAMES))
    folder = write_text_model(tmp_path / "m", "1 SIMPLE_PINHOLE 640 480 500 320 240", text)
    images = photos_in(tmp_path / "images", NAMES[:2])
    with pytest.raises(InputError, match=r"c\.jpg: registered in .* but missing"):
        read_colmap(folder, images)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin"])
def test_binary_models_cut_short_are_refused(tmp_path: Path, file: str) -> None:
    write_with_colmap(tmp_path, "PINHOLE")
    path = tmp_path / "binary" / file
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match="damaged COLMAP model"):
        read_colmap(tmp_path / "binary", photos_in(tmp_path / "images"))


def test_an_empty_folder_is_no_model(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected cameras and images"):
        read_colmap(tmp_path, tmp_path)


def transforms(**changes: Any) -> dict[str, Any]:
    frames = []
    for name, q, t in zip(NAMES, QUATERNIONS, TRANSLATIONS, strict=True):
        matrix = to_opengl(rotation_matrix(q), t)
        frames.append({"file_path": f"images/{name}", "transform_matrix": matrix.tolist()})
    base = {"w": 640, "h": 480, "fl_x": 500.0, "fl_y": 510.0, "cx": 321.0, "cy": 239.0}
    return base | {"frames": frames} | changes


def write_transforms(folder: Path, data: object) -> Path:
    photos_in(folder / "images")
    (folder / "transforms.json").write_text(json.dumps(data))
    return folder


def test_nerfstudio_poses_come_out_in_our_convention(tmp_path: Path) -> None:
    photos = read_nerfstudio(write_transforms(tmp_path, transforms(camera_model="PINHOLE", k1=9)))
    for photo, q, t in zip(photos, QUATERNIONS, TRANSLATIONS, strict=True):
        np.testing.assert_allclose(photo.rotation, rotation_matrix(q), atol=1e-12)
        np.testing.assert_allclose(photo.translation, t, atol=1e-12)
        assert photo.lens.is_pinhole  # PINHOLE means that coefficients do not apply
    i = photos[0].lens.intrinsics
    assert (i.width, i.height, i.fx, i.fy, i.cx, i.cy) == (640, 480, 500, 510, 321, 239)


def test_nerfstudio_per_frame_intrinsics_go_before_the_common_ones(tmp_path: Path) -> None:
    data = transforms(camera_model="OPENCV", k1=0.1, p2=0.01)
    data["frames"][1] |= {"fl_x": 700.0, "k1": 0.3, "mask_path": "images/a.jpg"}
    photos = read_nerfstudio(write_transforms(tmp_path, data))
    assert photos[0].lens.coefficients == (0.1, 0, 0, 0.01, 0)
    assert photos[1].lens.coefficients == (0.3, 0, 0, 0.01, 0)
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
    photo = read_nerfstudio(write_transforms(tmp_path, data))[0]
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
        (broken_frame(camera_model="OPENCV_FISHEYE"), "expected one of PINHOLE"),
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


def test_all_problems_come_in_one_message_up_to_a_limit() -> None:
    raise_all([])
    with pytest.raises(InputError) as error:
        raise_all([f"p{i}" for i in range(25)])
    assert str(error.value).splitlines() == [*(f"p{i}" for i in range(20)), "… and 5 more"]
