"""COLMAP's convention: world-to-camera, y down, z forward, pixel centres at +0.5."""

import numpy as np
import pytest

from mattgs_ops.capture.camera import (
    Camera,
    Intrinsics,
    from_opengl,
    in_frame,
    quaternion_of,
    rotation_of,
    sizes_of_their_own,
)
from tests.reference.opengl import to_opengl

PINHOLE = Intrinsics(width=8, height=6, fx=10.0, fy=12.0, cx=4.0, cy=3.0)


def test_a_point_on_the_axis_lands_on_the_principal_point() -> None:
    camera = Camera(PINHOLE, np.eye(3), np.zeros(3))
    pixels, depth = camera.project(np.array([[0.0, 0.0, 2.0]]))
    np.testing.assert_allclose(pixels, [[4.0, 3.0]])
    np.testing.assert_allclose(depth, [2.0])


def test_right_is_right_and_down_is_down() -> None:
    camera = Camera(PINHOLE, np.eye(3), np.zeros(3))
    pixels, _ = camera.project(np.array([[1.0, 1.0, 10.0]]))
    np.testing.assert_allclose(pixels, [[5.0, 4.2]])


def test_the_centre_is_where_the_camera_stands() -> None:
    rotation = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    centre = np.array([1.0, 2.0, 3.0])
    camera = Camera(PINHOLE, rotation, -rotation @ centre)
    np.testing.assert_allclose(camera.centre, centre)
    np.testing.assert_allclose(camera.matrix @ [*centre, 1.0], [0, 0, 0, 1])


def test_the_frame_holds_its_first_edges_and_not_its_last() -> None:
    places = [(0, 0), (7.99, 5.99), (8, 3), (4, 6), (-0.01, 3), (np.nan, 3), (np.inf, 3), (4, 3)]
    depths = np.array([1.0, 1e-9, *[1.0] * 5, 0.0])  # however near, and never at the camera itself
    found = in_frame(np.array(places), depths, (PINHOLE.width, PINHOLE.height))
    assert found.tolist() == [True, True, *[False] * 6]


def test_what_is_too_near_is_not_in_the_frame() -> None:
    pixels, depths = np.full((2, 2), 3.0), np.array([0.5, 0.6])
    assert in_frame(pixels, depths, (8, 6), beyond=0.5).tolist() == [False, True]


def test_depths_are_those_of_the_projection() -> None:
    rotation = rotation_of(np.array([0.9, 0.2, -0.3, 0.1]))
    camera = Camera(Intrinsics(640, 480, 500.0, 510.0, 320.0, 240.0), rotation, np.ones(3))
    points = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(camera.depths(points), camera.project(points)[1], rtol=1e-12)


def test_resizing_the_photo_scales_the_pixels() -> None:
    camera = Camera(PINHOLE, np.eye(3), np.zeros(3))
    point = np.array([[0.3, -0.2, 2.0]])
    whole, _ = camera.project(point)
    half, _ = camera.scaled(4, 3).project(point)
    np.testing.assert_allclose(half, whole / 2)


def test_opengl_cameras_look_along_their_negative_z() -> None:
    camera_to_world = np.eye(4)
    camera_to_world[:3, 3] = [0.0, 0.0, 5.0]
    rotation, translation = from_opengl(camera_to_world)
    camera = Camera(PINHOLE, rotation, translation)
    pixels, depth = camera.project(np.array([[0.0, 1.0, 0.0]]))
    assert depth[0] == pytest.approx(5.0)
    assert pixels[0, 1] < PINHOLE.cy, "up in the world is up in the image"


def test_opengl_there_and_back() -> None:
    rng = np.random.default_rng(0)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.linalg.det(rotation)
    translation = rng.normal(size=3)
    back = from_opengl(to_opengl(rotation, translation))
    np.testing.assert_allclose(back[0], rotation, atol=1e-12)
    np.testing.assert_allclose(back[1], translation, atol=1e-12)


def test_quaternions_and_rotations_are_inverse_also_for_half_turns() -> None:
    rng = np.random.default_rng(0)
    half_turns = [np.array(q) for q in ([0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0.6, 0, 0.8])]
    for q in [*rng.normal(size=(50, 4)), *map(np.asarray, half_turns), np.array([1.0, 0, 0, 0])]:
        rotation = rotation_of(q.astype(float))
        assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        back = quaternion_of(rotation)
        assert back[0] >= 0
        assert np.allclose(rotation_of(back), rotation, atol=1e-12)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    quarter = rotation_of(np.array([1.0, 0, 0, 1.0]))
    assert np.allclose(quarter @ [1, 0, 0], [0, 1, 0])


def test_a_size_is_its_own_where_no_other_has_it_either_way_up() -> None:
    assert sizes_of_their_own([(40, 30), (30, 40), (40, 20), (20, 50), (40, 30)]) == [2, 3]
    assert sizes_of_their_own([]) == []
