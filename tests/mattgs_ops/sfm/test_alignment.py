"""Specification of alignment by similarities and of pose errors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics, rotation_of
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.errors import InputError
from mattgs_ops.sfm import alignment
from mattgs_ops.sfm.alignment import Similarity
from mattgs_ops.sfm.pipeline import pose_error

INTRINSICS = Intrinsics(640, 480, 500.0, 500.0, 320.0, 240.0)


def some_similarity(rng: np.random.Generator) -> Similarity:
    return Similarity(rng.uniform(0.1, 9), rotation_of(rng.normal(size=4)), rng.normal(size=3))


def ring(count: int, rng: np.random.Generator) -> dict[str, Camera]:
    cameras = {}
    for k in range(count):
        rotation = rotation_of(rng.normal(size=4))
        centre = np.array([np.cos(k), np.sin(k), 0.1 * k])
        cameras[str(k)] = Camera(INTRINSICS, rotation, -rotation @ centre)
    return cameras


def moved(cameras: dict[str, Camera], by: Similarity) -> dict[str, Camera]:
    """Turn, shift and scale the world under the cameras."""
    out = {}
    for name, camera in cameras.items():
        rotation = camera.rotation @ by.rotation.T
        centre = by.apply(camera.centre[None])[0]
        out[name] = Camera(camera.intrinsics, rotation, -rotation @ centre)
    return out


@pytest.mark.parametrize("seed", range(5))
def test_a_similarity_is_found_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true, points = some_similarity(rng), rng.normal(size=(12, 3))
    found = alignment.similarity(points, true.apply(points))
    assert found.scale == pytest.approx(true.scale)
    assert np.allclose(found.rotation, true.rotation)
    assert np.allclose(found.translation, true.translation)


def test_points_in_a_plane_and_mirrored_points_still_give_a_rotation() -> None:
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(8, 3)) * [1, 1, 0]
    for target in (flat, flat + np.array([0, 0, 3]), rng.normal(size=(8, 3)), flat * [1, -1, 1]):
        assert np.linalg.det(alignment.similarity(flat, target).rotation) == pytest.approx(1)


def test_no_other_similarity_is_nearer() -> None:
    rng = np.random.default_rng(4)
    source, target = rng.normal(size=(20, 3)), rng.normal(size=(20, 3))
    best = alignment.similarity(source, target)

    def distance(s: Similarity) -> float:
        return float(((s.apply(source) - target) ** 2).sum())

    for _ in range(50):
        turn = rotation_of(np.array([1, *rng.normal(0, 0.02, 3)]))
        shift: NDArray[np.float64] = best.translation + rng.normal(0, 0.02, 3)
        other = Similarity(best.scale * rng.uniform(0.98, 1.02), turn @ best.rotation, shift)
        assert distance(best) <= distance(other)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((2, 3)), "at least 3 points, found 2"),
        (np.outer(np.arange(5.0), [1, 2, 3]), "not all on one line"),
        (np.ones((4, 3)), "not all on one line"),
    ],
)
def test_points_that_fix_nothing_are_refused(points: NDArray[np.float64], message: str) -> None:
    with pytest.raises(InputError, match=message):
        alignment.similarity(points, points)


def test_another_world_is_no_pose_error() -> None:
    rng = np.random.default_rng(2)
    truth = ring(9, rng)
    error = alignment.pose_error(moved(truth, some_similarity(rng)), truth)
    assert error.views == 9
    assert error.rotation_deg_max < 1e-6
    assert error.position_max < 1e-9
    assert error.focal == 0


def test_one_turned_camera_is_measured_in_degrees() -> None:
    rng = np.random.default_rng(2)
    truth = ring(8, rng)
    turn = np.radians(3.0)
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]]
    )
    estimated = dict(truth)
    rotation = about_x @ truth["5"].rotation
    estimated["5"] = Camera(INTRINSICS.scaled(640, 480), rotation, -rotation @ truth["5"].centre)
    error = alignment.pose_error(estimated, truth)
    assert error.rotation_deg_max == pytest.approx(3.0)
    assert error.rotation_deg_mean == pytest.approx(3.0 / 8)


def test_positions_are_shares_of_the_orbit_and_views_that_only_one_knows_do_not_count() -> None:
    # a ring of radius 2 with one camera moved by 0.02 along z: the others hold the alignment
    truth = {}
    for k in range(200):
        angle = 2 * np.pi * k / 200
        centre = np.array([2 * np.cos(angle), 2 * np.sin(angle), 0])
        truth[str(k)] = Camera(INTRINSICS, np.eye(3), -centre)
    estimated = dict(truth)
    estimated["0"] = Camera(INTRINSICS, np.eye(3), truth["0"].translation + np.array([0, 0, 0.02]))
    del estimated["7"]
    error = alignment.pose_error(estimated, truth)
    assert error.views == 199
    assert error.position_max == pytest.approx(0.01, rel=0.05)


def test_too_few_shared_views_are_refused() -> None:
    truth = ring(4, np.random.default_rng(0))
    with pytest.raises(InputError, match="at least 3 points, found 2"):
        alignment.pose_error({k: truth[k] for k in ("0", "1")}, truth)


@pytest.mark.parametrize("degrees", [0.0, 1e-7, 0.5, 90.0, 179.9])
def test_angles_are_exact_from_tiny_to_half_turns(degrees: float) -> None:
    a = np.radians(degrees)
    turned = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    assert alignment.angle_between(turned, np.eye(3)) == pytest.approx(degrees, rel=1e-6)


def test_cameras_on_a_line_have_no_pose_error(box_capture: PreparedCapture) -> None:
    """A camera on a rail: any turn about it fits, and nothing else of the result is wrong."""
    on_rail = []
    for place, view in enumerate(box_capture.views):
        assert view.camera is not None
        shift = -view.camera.rotation @ np.array([0.1 * place, 0.0, -3.0])
        on_rail.append(replace(view, camera=replace(view.camera, translation=shift)))
    rail = replace(box_capture, views=tuple(on_rail))
    assert pose_error(rail, rail.views) is None
    found = pose_error(box_capture, box_capture.views)
    assert found is not None
