"""Specification of the picture of structure-from-motion with and without masks."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import Scene, SparsePoints, View
from mattgs_ops.errors import InputError
from mattgs_ops.sfm import figure

SIZE = (60, 40)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """Four cameras on a circle of radius 3 at height 1 around the z axis, z pointing up."""
    views = []
    for k in range(4):
        a = k * np.pi / 2
        forward = np.array([-np.cos(a), -np.sin(a), 0])
        right = np.cross(forward, [0, 0, 1])
        rotation = np.stack([right, np.cross(forward, right), forward])
        centre = np.array([3 * np.cos(a), 3 * np.sin(a), 1.0])
        camera = Camera(Intrinsics(*SIZE, 50.0, 50.0, 30.0, 20.0), rotation, -rotation @ centre)
        photo, mask = tmp_path / f"{k}.png", tmp_path / f"{k}m.png"
        cv2.imwrite(str(photo), np.full((40, 60, 3), 60 * k, np.uint8))
        cv2.imwrite(str(mask), np.full((40, 60), 255, np.uint8))
        views.append(View(f"{k}.jpg", "train", *SIZE, photo, mask, camera))
    scene = Scene("ring", tmp_path, tuple(views), {})
    xyz = np.array([[0.0, 0, 0], [1, 0, 5], [0, 2, -5]])
    share = np.array([1, 0.5, 0], np.float32)
    scene.save(SparsePoints(xyz, np.zeros((3, 3), np.uint8), share, np.ones(3, np.int32)))
    inside = np.array([0, 1, 1, 1, 1, 0], dtype=bool)
    np.savez(
        tmp_path / "keypoints.npz",
        names=np.array(["0.jpg", "1.jpg", "2.jpg", "3.jpg"]),
        counts=np.array([2, 3, 0, 1]),
        xy=np.arange(12, dtype=np.float32).reshape(6, 2),
        inside=inside,
    )
    return scene


def test_key_points_go_to_their_views(scene: Scene) -> None:
    found = figure.read_keypoints(scene.folder)
    assert {name: (len(xy), int(inside.sum())) for name, (xy, inside) in found.items()} == {
        "0.jpg": (2, 1),
        "1.jpg": (3, 3),
        "2.jpg": (0, 0),
        "3.jpg": (1, 0),
    }
    assert found["1.jpg"][0].tolist() == [[4, 5], [6, 7], [8, 9]]


def test_from_above_heights_vanish_and_nothing_is_mirrored(scene: Scene) -> None:
    flat, centres = figure.from_above(scene, scene.points().xyz)
    assert np.allclose(np.linalg.norm(centres, axis=1), 3)
    assert np.allclose(np.linalg.norm(flat, axis=1), [0, 1, 2])
    x, y = flat[1], flat[2] / 2  # seen from above, y is a quarter turn left of x
    assert np.allclose([-x[1], x[0]], y)


def test_the_picture_is_drawn_the_same_each_time(scene: Scene, tmp_path: Path) -> None:
    figure.draw(scene, tmp_path / "a.png")
    figure.draw(scene, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    picture = np.asarray(cv2.imread(str(tmp_path / "a.png")))
    assert picture.shape[1] > 4 * picture.shape[0]  # five panels in a row
    figure.draw(scene, tmp_path / "c.png", view="0.jpg")
    assert (tmp_path / "c.png").read_bytes() != (tmp_path / "a.png").read_bytes()


def test_a_name_with_dollars_is_no_formula(scene: Scene, tmp_path: Path) -> None:
    named = replace(scene, views=tuple(replace(v, name=f"a$_${v.name}") for v in scene.views))
    with np.load(scene.folder / "keypoints.npz") as arrays:
        found = dict(arrays) | {"names": np.array([view.name for view in named.views])}
    np.savez(scene.folder / "keypoints.npz", **found)
    figure.draw(named, tmp_path / "a.png")
    assert (tmp_path / "a.png").is_file()


def test_a_view_that_is_not_there_is_refused(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no registered view 9\.jpg to show"):
        figure.draw(scene, tmp_path / "a.png", view="9.jpg")
