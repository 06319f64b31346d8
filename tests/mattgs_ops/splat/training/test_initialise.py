"""The start: which points, how large, how coloured, and what happens where there are none."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.scene import Scene, SparsePoints
from mattgs_ops.errors import StageError
from mattgs_ops.splat.photos import StoredView, store_views
from mattgs_ops.splat.training.initialise import (
    StartingPoints,
    initial_splats,
    scene_extent,
    starting_points,
)

MakeCameras = Callable[..., list[Camera]]


def sparse(count: int, share: float = 1.0) -> SparsePoints:
    rng = np.random.default_rng(0)
    return SparsePoints(
        rng.normal(size=(count, 3)),
        rng.integers(0, 256, (count, 3), dtype=np.uint8),
        np.full(count, share, np.float32),
        np.full(count, 5, np.int32),
    )


@pytest.fixture
def views(tiny_scene: Scene) -> list[StoredView]:
    return store_views(tiny_scene.registered("train"), "nobg", 48)


def test_original_starts_from_every_point_and_nobg_from_the_objects(
    views: list[StoredView],
) -> None:
    points = sparse(300)
    points.object_share[100:] = 0.79
    assert len(starting_points(points, views, "original", 0).xyz) == 300
    found = starting_points(points, views, "nobg", 0)
    np.testing.assert_array_equal(found.xyz, points.xyz[:100])
    np.testing.assert_array_equal(found.rgb, points.rgb[:100] / 255)
    assert found.source == "sparse"


def test_a_point_at_infinity_is_left_out(views: list[StoredView]) -> None:
    points = sparse(200)
    points.xyz[7, 1] = np.inf
    assert len(starting_points(points, views, "original", 0).xyz) == 199


def test_too_few_points_give_way_to_random_ones_inside_the_hull(views: list[StoredView]) -> None:
    found = starting_points(sparse(300, share=0.1), views, "nobg", 0)
    assert found.source == "random"
    assert len(found.xyz) == 10_000
    radius = np.linalg.norm(found.xyz, axis=1)
    assert radius.max() < 2, "the ball has radius 1, splats stick out a little"
    for view in views:  # nearly every point it sees is in its mask
        pixels, _ = view.camera.project(found.xyz)
        visible = ((pixels >= 0) & (pixels < [48, 36])).all(axis=1)
        columns, rows = pixels[visible].astype(int).T
        assert (view.mask[rows, columns] >= 128).mean() > 0.9
    assert 0.2 < found.rgb.mean() < 0.9


def test_the_random_start_is_repeatable_and_seeded(views: list[StoredView]) -> None:
    first, again, other = (starting_points(sparse(0), views, "nobg", s).xyz for s in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_without_masks_the_random_start_fills_the_common_volume(views: list[StoredView]) -> None:
    found = starting_points(sparse(0), views, "original", 0)
    seen = np.zeros(len(found.xyz))
    for view in views:
        pixels, depth = view.camera.project(found.xyz)
        seen += (depth > 0) & ((pixels >= 0) & (pixels < [48, 36])).all(axis=1)
    assert (seen >= len(views) / 2).all()


def test_cameras_that_share_no_volume_are_a_stated_failure(views: list[StoredView]) -> None:
    empty = [StoredView(v.name, v.camera, v.image, np.zeros_like(v.mask), v.photo) for v in views]
    with pytest.raises(StageError, match="share no volume"):
        starting_points(sparse(0), empty, "nobg", 0)


def test_more_points_than_allowed_are_thinned_by_the_seed() -> None:
    xyz = np.arange(300.0).reshape(100, 3)
    points = StartingPoints(xyz, xyz / 300, "sparse")
    assert points.at_most(100, seed=0) is points
    thinned = points.at_most(30, seed=0)
    assert len(thinned.xyz) == 30
    assert {tuple(row) for row in thinned.xyz} <= {tuple(row) for row in xyz}
    np.testing.assert_array_equal(thinned.rgb, thinned.xyz / 300)
    np.testing.assert_array_equal(thinned.xyz, points.at_most(30, seed=0).xyz)
    assert not np.array_equal(thinned.xyz, points.at_most(30, seed=1).xyz)


def test_splats_start_as_large_as_their_three_nearest_neighbours_are_far() -> None:
    points = StartingPoints(
        np.random.default_rng(1).normal(size=(60, 3)), np.zeros((60, 3)), "sparse"
    )
    splats = initial_splats(points)
    splats.check()
    for i in range(60):
        distances = np.sort(np.linalg.norm(points.xyz - points.xyz[i], axis=1))[1:4]
        expected = np.log(np.sqrt((distances**2).mean()))
        np.testing.assert_allclose(splats.log_scales[i], [expected] * 3, rtol=1e-5)


def test_splats_start_with_the_points_colour_and_a_tenths_opacity() -> None:
    rgb = np.array([[0.0, 0.5, 1.0], [0.2, 0.3, 0.4]])
    splats = initial_splats(StartingPoints(np.eye(3)[:2], rgb, "sparse"))
    shown = 0.5 / np.sqrt(np.pi) * splats.sh_dc.numpy() + 0.5  # Y00 = 1 / (2 sqrt(pi))
    np.testing.assert_allclose(shown, rgb, atol=1e-6)
    np.testing.assert_allclose(torch.sigmoid(splats.opacity_logits), 0.1, rtol=1e-6)
    assert torch.equal(splats.quaternions, torch.tensor([[1.0, 0, 0, 0]] * 2))
    assert not splats.sh_rest.any()


def test_points_in_one_place_still_have_an_extent() -> None:
    splats = initial_splats(StartingPoints(np.zeros((5, 3)), np.zeros((5, 3)), "sparse"))
    assert torch.isfinite(splats.log_scales).all()


def test_a_single_point_is_a_stated_failure() -> None:
    with pytest.raises(StageError, match="found 1"):
        initial_splats(StartingPoints(np.zeros((1, 3)), np.zeros((1, 3)), "sparse"))


def test_the_extent_is_the_farthest_camera_from_their_mean(make_cameras: MakeCameras) -> None:
    cameras = make_cameras(6)
    centres = np.array([camera.centre for camera in cameras])
    expected = 1.1 * max(np.linalg.norm(c - centres.mean(axis=0)) for c in centres)
    assert scene_extent(cameras) == pytest.approx(expected)
    with pytest.raises(StageError, match="from one place"):
        scene_extent(cameras[:1] * 3)
