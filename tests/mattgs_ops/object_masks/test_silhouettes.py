"""Silhouettes of the other views predict a view's map, without any texture."""

import numpy as np
import pytest

from mattgs_ops.object_masks.silhouettes import iou, predict
from tests.mattgs_ops.object_masks.ball import HEIGHT, VIEWS, WIDTH, orbit, truth


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
