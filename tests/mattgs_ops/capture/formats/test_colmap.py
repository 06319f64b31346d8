"""COLMAP projects as captures: models written by COLMAP itself, rigs and lenses included."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mattgs_ops.capture.camera import rotation_of
from mattgs_ops.capture.formats.colmap import model_folder, read_colmap
from mattgs_ops.errors import InputError

RNG = np.random.default_rng(5)
QUATERNIONS = RNG.normal(size=(3, 4))
TRANSLATIONS = RNG.normal(size=(3, 3))
NAMES = ("a.jpg", "b.jpg", "c.jpg")
MODELS: dict[str, list[float]] = {
    "SIMPLE_PINHOLE": [500, 320, 240],
    "PINHOLE": [500, 510, 320, 240],
    "SIMPLE_RADIAL": [500, 320, 240, 0.1],
    "RADIAL": [500, 320, 240, 0.1, -0.2],
    "OPENCV": [500, 510, 320, 240, 0.1, -0.2, 0.01, 0.02],
    "FULL_OPENCV": [500, 510, 320, 240, 0.1, -0.2, 0.01, 0.02, 0.05, 0.3, -0.1, 0.02],
    "OPENCV_FISHEYE": [500, 510, 320, 240, 0.1, -0.02, 0.01, 0.002],
    "SIMPLE_RADIAL_FISHEYE": [500, 320, 240, 0.1],
    "RADIAL_FISHEYE": [500, 320, 240, 0.1, -0.02],
    "SIMPLE_FISHEYE": [500, 320, 240],
    "FISHEYE": [500, 510, 320, 240],
}
PLANE = RNG.uniform(-0.6, 0.6, (20, 2))

# pycolmap has crashed processes that go on with other image libraries: it writes in its own
WRITE_MODELS = """
import json, sys, pathlib, numpy as np, pycolmap
job = json.loads(sys.argv[1])
out = pathlib.Path(job["out"])
pixels = {}
for name, params in job["models"].items():
    camera = pycolmap.Camera(camera_id=7, model=name, width=640, height=480, params=params)
    rays = np.column_stack([np.array(job["plane"]), np.ones(len(job["plane"]))])
    pixels[name] = camera.img_from_cam(rays).tolist()
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    for i, (file, q, t) in enumerate(zip(job["names"], job["quaternions"], job["translations"])):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(q[1:] + q[:1]), t)
        image = pycolmap.Image(name=file, camera_id=7, image_id=i + 1)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D([1.0, 2.0])] * (i % 2))
        model.add_image_with_trivial_frame(image, pose)
    for kind in ("text", "binary"):
        folder = out / name / kind
        folder.mkdir(parents=True)
        (model.write_text if kind == "text" else model.write_binary)(folder)
# two cameras on one rig, which COLMAP 3.12 and newer write as rigs and frames
model = pycolmap.Reconstruction()
make = pycolmap.Camera.create_from_model_name
left, right = (make(number, "PINHOLE", 500.0, 640, 480) for number in (1, 2))
model.add_camera(left)
model.add_camera(right)
rig = pycolmap.Rig(rig_id=1)
rig.add_ref_sensor(left.sensor_id)
beside = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0, 0.1, 0, 0.99])), np.array([0.2, 0, 0]))
rig.add_sensor(right.sensor_id, beside)
model.add_rig(rig)
for k in range(2):
    frame = pycolmap.Frame(frame_id=k + 1, rig_id=1)
    pair = [
        pycolmap.Image(name=f"{side}/{k}.jpg", camera_id=c, image_id=2 * k + c)
        for c, side in ((1, "left"), (2, "right"))
    ]
    for image in pair:
        image.frame_id = k + 1
        frame.add_data_id(image.data_id)
    frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0, 0, float(k)]))
    model.add_frame(frame)
    for image in pair:
        model.add_image(image)
    model.register_frame(k + 1)
(out / "rig").mkdir()
model.write_binary(out / "rig")
images = [model.image(n) for n in model.reg_image_ids()]
poses = {image.name: image.cam_from_world().matrix().tolist() for image in images}
print(json.dumps({"pixels": pixels, "rig": poses}))
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return a folder of models, one a camera model and one with a rig, and what COLMAP says."""
    out = tmp_path_factory.mktemp("models")
    unit = QUATERNIONS / np.linalg.norm(QUATERNIONS, axis=1, keepdims=True)
    job: dict[str, Any] = {
        "models": {name: [float(p) for p in params] for name, params in MODELS.items()},
        "plane": PLANE.tolist(),
        "names": NAMES,
        "quaternions": unit.tolist(),
        "translations": TRANSLATIONS.tolist(),
        "out": str(out),
    }
    command = [sys.executable, "-c", WRITE_MODELS, json.dumps(job)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    return out, json.loads(done.stdout)


def photos_in(folder: Path, names: tuple[str, ...] = NAMES) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")
    return folder


@pytest.mark.parametrize("kind", ["text", "binary"])
@pytest.mark.parametrize("model", MODELS)
def test_models_written_by_colmap_mean_what_colmap_means(
    written: tuple[Path, dict[str, Any]], tmp_path: Path, model: str, kind: str
) -> None:
    folder, said = written
    photos = read_colmap(folder / model / kind, photos_in(tmp_path)).photos
    assert [p.photo.name for p in photos] == list(NAMES)
    for photo, q, t in zip(photos, QUATERNIONS, TRANSLATIONS, strict=True):
        np.testing.assert_allclose(photo.rotation, rotation_of(q), atol=1e-12)
        np.testing.assert_allclose(photo.translation, t, atol=1e-12)
        lens = photo.lens
        assert (lens.intrinsics.width, lens.intrinsics.height) == (640, 480)
        assert lens.is_pinhole == model.endswith("PINHOLE")
        np.testing.assert_allclose(lens.to_pixels(PLANE), said["pixels"][model], atol=1e-9)


def test_cameras_on_a_rig_have_their_own_poses(
    written: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    folder, said = written
    assert (folder / "rig" / "frames.bin").is_file()
    assert (folder / "rig" / "rigs.bin").is_file()
    images = photos_in(tmp_path, tuple(said["rig"]))
    photos = read_colmap(folder / "rig", images).photos
    assert len(photos) == 4
    for photo in photos:
        expected = np.array(said["rig"][photo.photo.relative_to(images).as_posix()])
        np.testing.assert_allclose(photo.rotation, expected[:, :3], atol=1e-12)
        np.testing.assert_allclose(photo.translation, expected[:, 3], atol=1e-12)


def write_text_model(folder: Path, camera: str, images: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text(f"# cameras\n{camera}\n")
    (folder / "images.txt").write_text(f"# images\n# two lines each\n{images}")
    return folder


PINHOLE = "1 SIMPLE_PINHOLE 640 480 500 320 240"


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("1 FOV 640 480 1 1 1 1 0", "camera model FOV: expected one of SIMPLE_PINHOLE"),
        ("1 PINHOLE 640 480 500 320 240", "expected 4 parameters of PINHOLE, found 3"),
        ("1 SIMPLE_PINHOLE 640 480 -5 320 240", "expected positive width, height and focal"),
        ("1 SIMPLE_PINHOLE wide 480 5 320 240", "damaged COLMAP model"),
    ],
)
def test_cameras_that_are_none_are_named(tmp_path: Path, camera: str, message: str) -> None:
    folder = write_text_model(tmp_path / "m", camera, "")
    with pytest.raises(InputError, match=message):
        read_colmap(folder, tmp_path)


def test_a_registered_photo_that_is_missing_is_named(tmp_path: Path) -> None:
    text = "".join(f"{i} 1 0 0 0 0 0 {i} 1 {name}\n1 2 -1\n" for i, name in enumerate(NAMES))
    folder = write_text_model(tmp_path / "m", PINHOLE, text)
    images = photos_in(tmp_path / "images", NAMES[:2])
    with pytest.raises(InputError, match=r"c\.jpg: registered in .* but missing"):
        read_colmap(folder, images)


@pytest.mark.parametrize("name", ["../secret.jpg", "a/../../secret.jpg", "/etc/hostname"])
def test_names_that_lead_out_of_the_photos_folder_are_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.jpg").write_bytes(b"not yours")
    folder = write_text_model(tmp_path / "m", PINHOLE, f"1 1 0 0 0 0 0 0 1 {name}\n\n")
    with pytest.raises(InputError, match="leads out of"):
        read_colmap(folder, photos_in(tmp_path / "images"))


def test_a_pose_without_a_rotation_is_refused(tmp_path: Path) -> None:
    folder = write_text_model(tmp_path / "m", PINHOLE, "1 0 0 0 0 0 0 0 1 a.jpg\n\n")
    with pytest.raises(InputError, match=r"a\.jpg: its pose .* is none"):
        read_colmap(folder, photos_in(tmp_path / "images"))


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "sparse/1"])
def test_the_model_is_found(tmp_path: Path, place: str) -> None:
    assert model_folder(tmp_path) is None
    write_text_model(tmp_path / place, PINHOLE, "")
    assert model_folder(tmp_path) == tmp_path / place


def test_points_that_come_with_the_model_are_named(tmp_path: Path) -> None:
    rows = "".join(f"{i} 1 0 0 0 0 0 {i} 1 {name}\n\n" for i, name in enumerate(NAMES))
    folder = write_text_model(tmp_path / "m", PINHOLE, rows)
    images = photos_in(tmp_path / "images")
    assert read_colmap(folder, images).points is None
    (folder / "points3D.txt").write_text("# none\n")
    assert read_colmap(folder, images).points == folder
