"""Specification of random points in the masks' visual hull."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture import visual_hull
from mattgs_ops.capture.camera import Camera, Intrinsics, in_frame
from mattgs_ops.capture.masks import read_map
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.capture.sparse import inside
from mattgs_ops.errors import StageError


def test_the_volume_is_what_the_cameras_look_at(box_capture: PreparedCapture) -> None:
    cameras = [v.camera for v in box_capture.views if v.camera is not None]
    middle, half = visual_hull.shared_cube(cameras)
    assert np.allclose(middle, [0, 0, 0.3], atol=1e-9)  # where the capture's cameras aim
    distances = [float(np.linalg.norm(camera.centre - middle)) for camera in cameras]
    lens = cameras[0].intrinsics
    assert half == pytest.approx(np.median(distances) * lens.width / 2 / lens.fx)


def test_without_masks_points_are_in_half_the_frames(box_capture: PreparedCapture) -> None:
    cameras = [v.camera for v in box_capture.views if v.camera is not None]
    points = visual_hull.sample(cameras, None, 200, np.random.default_rng(0))
    assert points.shape == (200, 3)
    seen = np.zeros(len(points))
    for camera in cameras:
        pixels, depths = camera.project(points)
        size = [camera.intrinsics.width, camera.intrinsics.height]
        seen += (depths > 0) & ((pixels >= 0) & (pixels < size)).all(axis=1)
    assert (seen >= len(cameras) / 2).all()


def test_points_fill_the_hull_and_nothing_else(box_capture: PreparedCapture) -> None:
    points = visual_hull.fill(box_capture.views, 800, seed=5)
    assert points.xyz.shape == (800, 3)
    assert (points.object_share == 1).all()
    assert points.views_seen.min() >= 5
    # an arc of views leaves the hull deeper than the box, but no wider as they see it
    for view in box_capture.views:
        assert view.camera is not None
        pixels, depths = view.camera.project(points.xyz)
        assert view.mask is not None
        hit = inside(read_map(view.mask), pixels, depths)
        assert hit.mean() > 0.85
    # and nothing of the box is left out: its share of the hull is its share of the points
    half = np.array([0.5, 0.4, 0.35])
    inside_box = (np.abs(points.xyz - [0, 0, 0.35]) <= half).all(axis=1)
    assert inside_box.mean() > 0.4


def test_the_seed_decides(box_capture: PreparedCapture) -> None:
    first, again, other = (visual_hull.fill(box_capture.views, 50, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.xyz, again.xyz)
    assert not np.array_equal(first.xyz, other.xyz)


def test_colours_know_nothing_of_test_photos(box_capture: PreparedCapture, tmp_path: Path) -> None:
    poisoned = []
    for view in box_capture.views:
        photo = view.photo
        if view.split == "test":
            photo = tmp_path / photo.name
            cv2.imwrite(str(photo), np.full((view.height, view.width, 3), (0, 0, 255), np.uint8))
        poisoned.append(replace(view, photo=photo))
    assert any(view.split == "test" for view in box_capture.views)
    clean, other = (visual_hull.fill(views, 50, seed=1) for views in (box_capture.views, poisoned))
    np.testing.assert_array_equal(clean.rgb, other.rgb)


def test_a_colour_is_the_mean_of_the_training_photos_whose_masks_hold_the_point(
    box_capture: PreparedCapture,
) -> None:
    points = visual_hull.fill(box_capture.views, 20, seed=6)
    assert len(np.unique(points.rgb, axis=0)) > 1
    colours: list[list[np.ndarray]] = [[] for _ in points.xyz]
    for view in box_capture.views:
        if view.split == "test" or view.camera is None or view.mask is None:
            continue
        photo, mask = np.asarray(cv2.imread(str(view.photo))), read_map(view.mask)
        for place, (x, y) in enumerate(view.camera.project(points.xyz)[0]):
            column, row = int(np.floor(x)), int(np.floor(y))
            if 0 <= column < view.width and 0 <= row < view.height and mask[row, column]:
                colours[place].append(photo[row, column, ::-1])  # OpenCV reads blue first
    assert points.views_seen.tolist() == [len(seen) for seen in colours]
    expected = [np.mean(seen, axis=0) for seen in colours]
    np.testing.assert_allclose(points.rgb, expected, atol=0.5 + 1e-9)


@pytest.mark.parametrize(("bad", "carved"), [(1, False), (2, True)])
def test_one_bad_mask_of_ten_carves_nothing_away_and_two_do(bad: int, carved: bool) -> None:
    lens, cameras = Intrinsics(24, 18, 20.0, 20.0, 12.0, 9.0), []
    for angle in np.linspace(0, 2 * np.pi, 10, endpoint=False):
        forward = np.array([np.cos(angle), np.sin(angle), 0.0])
        rotation = np.stack([[-forward[1], forward[0], 0.0], [0.0, 0.0, 1.0], forward])
        cameras.append(Camera(lens, rotation, np.array([0.0, 0.0, 3.0])))
    masks = [np.full((18, 24), 255 * (place >= bad), np.uint8) for place in range(10)]
    points = visual_hull.sample(cameras, masks, 50, np.random.default_rng(0))
    before_bad = [in_frame(*camera.project(points), (24, 18)) for camera in cameras[:bad]]
    assert len(points) == 50
    assert bool(np.all(before_bad, axis=0).any()) != carved


def test_a_view_in_which_nothing_was_found_carves_nothing(
    box_capture: PreparedCapture, tmp_path: Path
) -> None:
    black = tmp_path / "black.png"
    cv2.imwrite(str(black), np.zeros((180, 240), np.uint8))
    first = next(view for view in box_capture.views if view.split == "train")
    dropped = [replace(v, mask=black) if v is first else v for v in box_capture.views]
    without = [v for v in box_capture.views if v is not first]
    found, expected = (visual_hull.fill(views, 200, seed=3) for views in (dropped, without))
    np.testing.assert_array_equal(found.xyz, expected.xyz)


def test_random_points_stay_with_a_model_and_leave_where_masks_no_longer_are(
    box_capture: PreparedCapture, tmp_path: Path
) -> None:
    views = box_capture.views
    random = visual_hull.fill(views, 100, seed=4)
    model = visual_hull.fill(views, 7, seed=5)
    before = visual_hull.joined(model, random)
    kept = visual_hull.with_random(model, before, views)
    np.testing.assert_array_equal(kept.xyz, before.xyz)
    assert visual_hull.with_random(model, model, views) is model
    right = []
    for view in views:  # the left half of each mask is gone
        half = read_map(view.mask) if view.mask else np.zeros((1, 1), np.uint8)
        half[:, : half.shape[1] // 2] = 0
        cv2.imwrite(str(tmp_path / f"{view.name}.png"), half)
        right.append(replace(view, mask=tmp_path / f"{view.name}.png"))
    fewer = visual_hull.with_random(model, before, right)
    assert len(model.xyz) < len(fewer.xyz) < len(before.xyz)
    nowhere = np.zeros((180, 240), np.uint8)
    nowhere[0, 0] = 255  # a hull that holds none of them says nothing of them
    cv2.imwrite(str(tmp_path / "nowhere.png"), nowhere)
    elsewhere = [replace(view, mask=tmp_path / "nowhere.png") for view in views]
    stayed = visual_hull.with_random(model, before, elsewhere)
    np.testing.assert_array_equal(stayed.xyz, before.xyz)


@pytest.mark.parametrize("along", [-3.0, 0.0, 50.0])
def test_cameras_that_look_the_same_way_share_a_volume_wherever_the_origin_is(
    along: float,
) -> None:
    lens = Intrinsics(240, 180, 200.0, 200.0, 120.0, 90.0)
    centres = [np.array([x, y, along]) for x in (-1.0, 0.0, 1.0) for y in (-0.5, 0.5)]
    cameras = [Camera(lens, np.eye(3), -centre) for centre in centres]
    points = visual_hull.sample(cameras, None, 50, np.random.default_rng(0))
    assert len(points) == 50
    assert (points[:, 2] > along).all()


def test_masks_without_a_common_volume_are_an_error(box_capture: PreparedCapture) -> None:
    black = box_capture.folder / "black.png"
    cv2.imwrite(str(black), np.zeros((180, 240), np.uint8))
    views = [replace(view, mask=black) for view in box_capture.views]
    with pytest.raises(StageError, match="no common volume"):
        visual_hull.fill(views, 100, seed=0)
