"""What another program is given: what the built-in methods see, and nothing of a test view."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from mattgs_ops.capture.camera import Camera, Intrinsics, from_opengl
from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.formats.nerfstudio import read_nerfstudio
from mattgs_ops.capture.formats.point_cloud import read_points
from mattgs_ops.capture.scene import Scene
from mattgs_ops.errors import StageError
from mattgs_ops.frozen import Background
from mattgs_ops.splat.photos import load_view
from mattgs_ops.trainer import Layout
from mattgs_ops.trainers.dataset import write_dataset

RESOLUTION = 40
LAYOUTS: tuple[Layout, ...] = ("colmap", "nerfstudio", "nerf")


def written(
    scene: Scene, folder: Path, layout: Layout, background: Background = "nobg", **other: Any
) -> Path:
    options = {"resolution": RESOLUTION, "most_points": 10_000, "seed": 0} | other
    write_dataset(scene, background, folder, layout=layout, **options)
    return folder


def images(folder: Path) -> dict[str, np.ndarray]:
    return {path.name: np.asarray(Image.open(path)) for path in sorted(folder.rglob("*.png"))}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("background", ["original", "nobg"])
def test_photos_are_those_that_the_built_in_methods_train_on(
    tiny_scene: Scene, tmp_path: Path, layout: Layout, background: Background
) -> None:
    found = images(written(tiny_scene, tmp_path / "data", layout, background))
    views = tiny_scene.registered("train")
    assert list(found) == [f"{view.name}.png" for view in views]
    for view in views:
        expected = load_view(view, background, RESOLUTION).image
        assert expected.shape[1] == RESOLUTION
        np.testing.assert_array_equal(found[f"{view.name}.png"], np.rint(expected * 255))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("background", ["original", "nobg"])
def test_nothing_of_a_test_view_is_there(
    tiny_scene: Scene, tmp_path: Path, layout: Layout, background: Background
) -> None:
    folder = written(tiny_scene, tmp_path / "data", layout, background)
    tests = tiny_scene.registered("test")
    assert tests
    files = [path for path in folder.rglob("*") if path.is_file()]
    for view in tests:
        pixels = np.rint(load_view(view, background, RESOLUTION).image * 255)
        assert not any(np.array_equal(image, pixels) for image in images(folder).values())
        for path in files:
            assert view.name not in path.name
            assert view.name.encode() not in path.read_bytes()
            assert view.photo.read_bytes() != path.read_bytes()
    # the search finds what is there
    assert any(tiny_scene.registered("train")[0].name in path.name for path in files)


def same_camera(found: Camera, expected: Camera) -> None:
    np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-12)
    one, other = found.intrinsics, expected.intrinsics
    np.testing.assert_allclose(list(vars(one).values()), list(vars(other).values()), rtol=1e-12)


def expected_cameras(scene: Scene) -> dict[str, Camera]:
    views = scene.registered("train")
    return {f"{v.name}.png": load_view(v, "original", RESOLUTION).camera for v in views}


def test_colmaps_model_holds_the_cameras_at_the_photos_size(
    tiny_scene: Scene, tmp_path: Path
) -> None:
    model = read_model(written(tiny_scene, tmp_path / "data", "colmap") / "sparse" / "0")
    expected = expected_cameras(tiny_scene)
    assert {image.name for image in model.images.values()} == set(expected)
    for image in model.images.values():
        lens = model.cameras[image.camera]
        fx, fy, cx, cy = lens.params
        pinhole = Intrinsics(lens.width, lens.height, fx, fy, cx, cy)
        same_camera(Camera(pinhole, image.rotation, image.translation), expected[image.name])
    np.testing.assert_allclose(model.xyz, tiny_scene.points().xyz)


def test_nerfstudios_file_is_read_back_as_it_was(tiny_scene: Scene, tmp_path: Path) -> None:
    folder = written(tiny_scene, tmp_path / "data", "nerfstudio")
    document = json.loads((folder / "transforms.json").read_text())
    expected = expected_cameras(tiny_scene)
    assert len(document["frames"]) == len(expected)
    for frame in document["frames"]:
        pose = from_opengl(np.array(frame["transform_matrix"]))
        lens = Intrinsics(*(frame[k] for k in ("w", "h", "fl_x", "fl_y", "cx", "cy")))
        same_camera(Camera(lens, *pose), expected[Path(frame["file_path"]).name])
        assert (folder / frame["file_path"]).is_file()
    read_nerfstudio(folder)  # as it would be by whoever is given it
    points = read_points(folder / document["ply_file_path"])
    np.testing.assert_allclose(points.xyz, tiny_scene.points().xyz, atol=1e-6)


def test_what_frames_do_not_share_stands_nowhere_but_in_them(
    tiny_scene: Scene, tmp_path: Path
) -> None:
    """In nerfstudio a focal length at the top is that of every frame."""
    view = tiny_scene.registered("train")[2]
    assert view.camera is not None
    lens = replace(view.camera.intrinsics, fx=70.0)
    other = replace(view, camera=replace(view.camera, intrinsics=lens))
    views = tuple(other if one.name == view.name else one for one in tiny_scene.views)
    folder = written(replace(tiny_scene, views=views), tmp_path / "data", "nerfstudio")
    document = json.loads((folder / "transforms.json").read_text())
    assert "fl_x" not in document
    assert document["fl_y"] == document["frames"][0]["fl_y"]
    assert len({frame["fl_x"] for frame in document["frames"]}) == 2


def test_the_release_finds_normals_beside_nerfs_files(tiny_scene: Scene, tmp_path: Path) -> None:
    folder = written(tiny_scene, tmp_path / "data", "nerf")
    vertex = PlyData.read(str(folder / "points3d.ply"))["vertex"]
    names = [one.name for one in vertex.properties]
    assert names == ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"]
    assert read_points(folder / "points3d.ply").xyz.shape == tiny_scene.points().xyz.shape


def test_nerfs_files_name_the_photos_and_their_one_angle(tiny_scene: Scene, tmp_path: Path) -> None:
    folder = written(tiny_scene, tmp_path / "data", "nerf")
    document = json.loads((folder / "transforms_train.json").read_text())
    expected = expected_cameras(tiny_scene)
    for frame in document["frames"]:
        photo = folder / f"{frame['file_path']}.png"
        lens = expected[photo.name].intrinsics
        assert photo.is_file()
        focal = lens.width / (2 * np.tan(document["camera_angle_x"] / 2))
        assert focal == pytest.approx(lens.fx)
    assert json.loads((folder / "transforms_test.json").read_text())["frames"] == []


def test_nerfs_layout_refuses_an_axis_that_is_not_in_the_middle(
    tiny_scene: Scene, tmp_path: Path
) -> None:
    view = tiny_scene.registered("train")[2]
    assert view.camera is not None
    lens = vars(view.camera.intrinsics) | {"cx": 30.0}
    moved = Camera(Intrinsics(**lens), view.camera.rotation, view.camera.translation)
    views = [
        type(v)(**(vars(v) | {"camera": moved})) if v.name == view.name else v
        for v in tiny_scene.views
    ]
    scene = Scene(tiny_scene.name, tiny_scene.folder, tuple(views), tiny_scene.extra)
    with pytest.raises(StageError, match=rf"{view.name}.*middle.*use the layout `colmap`"):
        written(scene, tmp_path / "data", "nerf")


def test_points_are_those_that_a_training_of_this_size_starts_from(
    tiny_scene: Scene, tmp_path: Path
) -> None:
    folder = written(tiny_scene, tmp_path / "data", "colmap", most_points=50)
    assert len(read_model(folder / "sparse" / "0").xyz) == 50


def test_a_scene_without_training_views_is_refused(tiny_scene: Scene, tmp_path: Path) -> None:
    tests = tuple(view for view in tiny_scene.views if view.split == "test")
    scene = Scene(tiny_scene.name, tiny_scene.folder, tests, tiny_scene.extra)
    with pytest.raises(StageError, match="2 registered training views at least, found 0"):
        written(scene, tmp_path / "data", "colmap")
