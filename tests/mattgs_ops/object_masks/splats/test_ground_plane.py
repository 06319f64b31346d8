"""The plane an object stands on: found where there is one, not invented where there is none."""

import numpy as np
import pytest

from mattgs_ops.object_masks.splats.ground_plane import find

Array = np.ndarray


def desk(rng: np.random.Generator, count: int = 600) -> Array:
    """Points on z = 0.2, a hundredth thick."""
    flat = rng.uniform(-3, 3, (count, 3))
    flat[:, 2] = 0.2 + rng.normal(0, 0.01, count)
    return flat


def clutter(rng: np.random.Generator, count: int) -> Array:
    return rng.uniform([-3, -3, 0.2], [3, 3, 2.5], (count, 3))


@pytest.fixture
def cameras() -> Array:
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    return np.stack([4 * np.cos(angles), 4 * np.sin(angles), np.full(12, 2.0)], axis=1)


def test_the_desk_is_found_among_clutter_and_faces_the_cameras(cameras: Array) -> None:
    rng = np.random.default_rng(0)
    plane = find(np.concatenate([desk(rng), clutter(rng, 700)]), 1.0, cameras)
    assert plane is not None
    np.testing.assert_allclose(plane.normal, [0, 0, 1], atol=0.01)
    assert plane.offset == pytest.approx(0.2, abs=0.01)
    assert plane.share == pytest.approx(600 / 1300, abs=0.03)
    np.testing.assert_allclose(plane.heights(np.array([[1.0, 2, 0.7]])), [0.5], atol=0.03)


def test_clutter_alone_is_no_desk(cameras: Array) -> None:
    assert find(clutter(np.random.default_rng(1), 1500), 1.0, cameras) is None


def test_a_wall_with_cameras_to_both_sides_is_no_desk(cameras: Array) -> None:
    wall = desk(np.random.default_rng(2))[:, [2, 0, 1]]
    assert find(wall, 1.0, cameras) is None


def test_a_few_points_say_nothing(cameras: Array) -> None:
    assert find(desk(np.random.default_rng(3), 40), 1.0, cameras) is None


def test_points_on_one_spot_are_survived(cameras: Array) -> None:
    assert find(np.zeros((80, 3)), 1.0, cameras) is None
