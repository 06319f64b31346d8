"""Silhouettes of the other views predict a view's map, without any texture."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from mattgs_ops.capture.camera import Camera
from mattgs_ops.object_masks import silhouettes
from mattgs_ops.object_masks.silhouettes import around_half, iou, predict, resized, seen_within
from tests.mattgs_ops.object_masks.ball import (
    CENTRE,
    HEIGHT,
    RADIUS,
    VIEWS,
    WIDTH,
    orbit,
    truth,
)

ALL = [True] * VIEWS


def test_right_maps_meet_each_other_to_a_pixel_or_two() -> None:
    cameras = orbit()
    maps = [truth(camera) for camera in cameras]
    found = predict(cameras, maps)
    assert found is not None
    assert found.share == 1
    # a pixel around silhouettes of forty costs a tenth
    assert min(found.agreement) > 0.75
    for soft, mask in zip(found.predicted, maps, strict=True):
        assert (soft[mask > 0] >= 0.5).mean() > 0.98


def test_a_leak_and_a_lost_half_are_seen_from_the_other_views() -> None:
    cameras = orbit()
    maps = [truth(camera) for camera in cameras]
    maps[2][5:30, 2:30] = 1
    maps[7][:, : WIDTH // 2] = 0
    found = predict(cameras, maps)
    assert found is not None
    assert found.agreement[2] < found.agreement[0]
    assert (found.predicted[2][5:20, 2:20] < 0.5).all()
    assert iou(found.predicted[7] >= 0.5, truth(cameras[7]) > 0) > 0.7


def test_maps_that_have_nothing_in_common_do_not_agree() -> None:
    cameras, rng = orbit(), np.random.default_rng(0)
    maps = []
    for _ in cameras:
        soft = np.zeros((HEIGHT, WIDTH), np.float32)
        row, column = rng.integers(0, HEIGHT - 20), rng.integers(0, WIDTH - 20)
        soft[row : row + 20, column : column + 20] = 1
        maps.append(soft)
    found = predict(cameras, maps)
    assert found is None or found.mean < 0.3


def test_a_view_that_found_nothing_predicts_nothing_and_is_predicted() -> None:
    cameras = orbit()
    maps = [truth(camera) for camera in cameras]
    maps[4] = np.zeros_like(maps[4])
    found = predict(cameras, maps)
    assert found is not None
    assert found.share == 1
    assert len(found.agreement) == VIEWS - 1
    assert iou(found.predicted[4] >= 0.5, truth(cameras[4]) > 0) > 0.7


@pytest.mark.parametrize("with_object", [0, 1])
def test_fewer_than_two_maps_predict_nothing(with_object: int) -> None:
    cameras = orbit()
    maps = [truth(c) * (i < with_object) for i, c in enumerate(cameras)]
    assert predict(cameras, [m.astype(np.float32) for m in maps]) is None


def test_views_that_all_look_the_same_way_predict_nothing() -> None:
    cameras = [orbit()[0]] * 4
    assert predict(cameras, [truth(camera) for camera in cameras]) is None


def test_views_that_are_held_out_are_predicted_and_predict_nothing() -> None:
    cameras = orbit()
    trained = [index % 3 > 0 for index in range(VIEWS)]
    right = [truth(camera) for camera in cameras]
    wrong = [soft if use else 1 - soft for soft, use in zip(right, trained, strict=True)]
    found, same = predict(cameras, wrong, trained), predict(cameras, right, trained)
    assert found is not None
    assert same is not None
    assert found.agreement == same.agreement
    assert len(found.agreement) == sum(trained)
    for index, use in enumerate(trained):
        np.testing.assert_array_equal(found.predicted[index] >= 0.5, same.predicted[index] >= 0.5)
        if not use:
            assert iou(found.predicted[index] >= 0.5, right[index] > 0) > 0.7


def test_the_share_that_is_wanted_becomes_a_half() -> None:
    shares = np.array([[0.0, 0.3, 0.6, 0.7, 1.0]], np.float32)
    np.testing.assert_allclose(around_half(shares, 0.6), [[0, 0.25, 0.5, 0.625, 1]], rtol=1e-6)
    np.testing.assert_allclose(around_half(shares, 1.0), [[0, 0.15, 0.3, 0.35, 1]], rtol=1e-6)


def test_maps_are_resized_to_the_other_ones_rows_and_columns() -> None:
    (large,) = resized([np.full((4, 6), 0.25, np.float32)], [np.zeros((8, 20), np.float32)])
    assert large.shape == (8, 20)
    np.testing.assert_array_equal(large, 0.25)


def test_points_fill_a_ball_around_the_object() -> None:
    cameras = [
        replace(one, intrinsics=replace(one.intrinsics, cx=one.intrinsics.cx + 9, fx=75.0, fy=75.0))
        for one in orbit()
    ]
    points = silhouettes._points(cameras, [truth(one) > 0 for one in cameras], ALL)
    assert points is not None
    np.testing.assert_allclose(points.mean(axis=0), CENTRE, atol=0.01)
    # what a camera sees of a ball is a little larger than the ball
    far = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    assert far == pytest.approx(silhouettes.MARGIN * RADIUS, rel=0.1)
    assert far > silhouettes.MARGIN * RADIUS
    assert len(points) == pytest.approx(np.pi / 6 * silhouettes.GRID**3, rel=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_predictions_are_those_of_the_definition(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(silhouettes, "GRID", 12)
    rng = np.random.default_rng(seed)
    cameras = [cropped(camera, rng) for camera in orbit()]
    trained = [bool(use) for use in rng.random(VIEWS) < 0.8]
    maps = [blobs(rng, camera) for camera in cameras]
    maps[3] = np.zeros_like(maps[3])
    found = predict(cameras, maps, trained)
    assert found is not None
    counted = [use and bool((soft >= 0.5).any()) for use, soft in zip(trained, maps, strict=True)]
    points = silhouettes._points(cameras, [soft >= 0.5 for soft in maps], counted)
    assert points is not None
    expected, agreement, share = by_definition(cameras, maps, counted, points)
    assert found.share == share
    np.testing.assert_allclose(found.agreement, agreement)
    for one, other in zip(found.predicted, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)


def cropped(camera: Camera, rng: np.random.Generator) -> Camera:
    """Return a camera of another size, which cuts something off and stands nearer or farther."""
    lens = camera.intrinsics
    width, height = (int(rng.integers(30, side)) for side in (lens.width, lens.height))
    crop = replace(lens, width=width, height=height, cx=width / 2 + 4, cy=height / 2 - 3)
    nearer = camera.translation * [1, 1, rng.uniform(0.3, 1.2)]
    return replace(camera, intrinsics=crop, translation=nearer)


def blobs(rng: np.random.Generator, camera: Camera) -> np.ndarray:
    """Return a smooth random map [H, W] in [0, 1]."""
    lens = camera.intrinsics
    noise = gaussian_filter(rng.normal(size=(lens.height, lens.width)), 4)
    return np.clip(0.6 + 4 * noise, 0, 1).astype(np.float32)


def by_definition(
    cameras: list[Camera], maps: list[np.ndarray], counted: list[bool], points: np.ndarray
) -> tuple[list[np.ndarray], list[float], float]:
    """Return predictions, agreement and share as the module's docstring defines them, in loops."""
    own = [soft >= 0.5 for soft in maps]
    hits = [[pixel_of(camera, point) for point in points] for camera in cameras]
    pitch = np.ptp(points[:, 0]) / silhouettes.GRID
    shares, unwatched = [], []
    for k, camera in enumerate(cameras):
        share, unseen = np.zeros(maps[k].shape), np.zeros(maps[k].shape)
        others = [u for u in range(len(cameras)) if counted[u] and u != k]
        for p in range(len(points)):
            if (pixel := hits[k][p]) is None:
                continue
            said = [own[u][hits[u][p]] for u in others if hits[u][p] is not None]
            if said and len(said) >= silhouettes.FEWEST_SHARE * len(others):
                share[pixel] = max(share[pixel], np.mean(said))
            else:
                unseen[pixel] = 1
        depths = camera.depths(points)
        near = np.quantile(depths[depths > 0], silhouettes.NEAREST)
        gap = int(np.clip(np.ceil(pitch * camera.intrinsics.fx / near), 1, silhouettes.MOST_GAP))
        shares.append(closed(share, gap))
        unwatched.append(closed(unseen, gap) > 0)
    tried = {}
    for wanted in silhouettes.SHARES:
        said_object = [(share >= wanted - 1e-9) for share in shares]
        tried[wanted] = [iou(said_object[k], own[k]) for k in range(len(own)) if counted[k]]
    best = max(silhouettes.SHARES, key=lambda wanted: np.mean(tried[wanted]))
    predicted = []
    for share, hidden, mask in zip(shares, unwatched, own, strict=True):
        above = 0.5 + 0.5 * (share - best) / (1 - best) if best < 1 else np.ones_like(share)
        soft = np.where(share >= best - 1e-9, above, share / (2 * best))
        predicted.append(np.where(hidden & mask, 1.0, soft))
    return predicted, tried[best], best


def pixel_of(camera: Camera, point: np.ndarray) -> tuple[int, int] | None:
    """Return row and column of a point, None where the camera does not see it."""
    x, y, depth = camera.rotation @ point + camera.translation
    if depth <= 0:
        return None
    lens = camera.intrinsics
    column = int(np.floor(x / depth * lens.fx + lens.cx))
    row = int(np.floor(y / depth * lens.fy + lens.cy))
    seen = 0 <= column < lens.width and 0 <= row < lens.height
    return (row, column) if seen else None


def closed(image: np.ndarray, gap: int) -> np.ndarray:
    """Spread values [H, W] over the gaps between points, and one pixel around them."""
    side = 2 * gap + 1
    grown = maximum_filter(image, side, mode="constant", cval=0.0)
    return minimum_filter(grown, side - 2, mode="constant", cval=1.0) if gap > 1 else grown


def test_views_are_seen_within_the_largest_angle_between_any_two() -> None:
    cameras = orbit()
    ways = [(camera.centre - CENTRE) / np.linalg.norm(camera.centre - CENTRE) for camera in cameras]
    angles = [np.degrees(np.arccos(a @ b)) for a, b in combinations(ways, 2)]
    assert seen_within(cameras, CENTRE) == pytest.approx(max(angles), abs=1e-4)
    assert seen_within(cameras[:1], CENTRE) == pytest.approx(0, abs=1e-4)
