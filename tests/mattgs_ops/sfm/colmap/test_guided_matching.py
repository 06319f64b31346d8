"""Specification of matching along epipolar lines of known poses."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics, rotation_of
from mattgs_ops.sfm.colmap import guided_matching, matching
from mattgs_ops.sfm.colmap.guided_matching import homogeneous

FOCAL = 500.0
INTRINSICS = Intrinsics(640, 480, FOCAL, FOCAL, 320.0, 240.0)


def two_cameras(rng: np.random.Generator) -> dict[int, Camera]:
    turn = rotation_of(np.array([1, *rng.normal(0, 0.05, 3)]))
    return {
        0: Camera(INTRINSICS, np.eye(3), np.zeros(3)),
        1: Camera(INTRINSICS, turn, np.array([-0.6, 0.1, 0.05])),
    }


def rays(camera: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    i = camera.intrinsics
    return (camera.project(points)[0] - [i.cx, i.cy]) / [i.fx, i.fy]


def descriptors(rng: np.random.Generator, count: int) -> NDArray[np.uint8]:
    raw = rng.random((count, 128)) ** 4
    return np.rint(raw / np.linalg.norm(raw, axis=1, keepdims=True) * 512).astype(np.uint8)


@pytest.mark.parametrize("seed", range(3))
def test_a_points_projections_lie_on_each_others_lines(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cameras, points = two_cameras(rng), rng.uniform(-1, 1, (20, 3)) + np.array([0, 0, 4])
    first, second = rays(cameras[0], points), rays(cameras[1], points)
    matrix = guided_matching.essential(cameras[0], cameras[1])
    there = guided_matching.epipolar_lines(matrix, first)
    back = guided_matching.epipolar_lines(matrix.T, second)
    assert np.abs((there * homogeneous(second)).sum(axis=1)).max() < 1e-12
    assert np.abs((back * homogeneous(first)).sum(axis=1)).max() < 1e-12
    assert np.allclose(guided_matching.essential(cameras[1], cameras[0]), matrix.T)


def test_near_means_a_right_angle_to_either_line_within_the_band() -> None:
    # a sideways step: the line of (x, y) is the row y
    step = Camera(INTRINSICS, np.eye(3), np.array([-1.0, 0, 0]))
    matrix = guided_matching.essential(Camera(INTRINSICS, np.eye(3), np.zeros(3)), step)
    first, second = np.array([[0.3, 0.1], [0, 0]]), np.array([[-0.2, 0.1], [0.5, 0.13]])
    lines = guided_matching.epipolar_lines(matrix, first)
    assert np.allclose(np.abs(lines @ homogeneous(second).T), [[0, 0.03], [0.1, 0.13]])
    for bands, expected in (
        ((0.02, 0.2), [[True, False], [False, False]]),
        ((0.2, 0.05), [[True, True], [False, False]]),
        ((0.2, 0.11), [[True, True], [True, False]]),
    ):
        near = guided_matching.near_lines(matrix, first, second, bands)
        assert near(slice(0, 2)).tolist() == expected
        assert near(slice(1, 2)).tolist() == expected[1:]


def test_repeated_structures_match_near_their_lines_only() -> None:
    """Twenty equal screws: no ratio test over whole photos passes them, their lines tell."""
    rng = np.random.default_rng(0)
    cameras = two_cameras(rng)
    grid = np.linspace(-1, 1, 20)
    points = np.stack([0.3 * np.sin(9 * grid), grid, 4 + 0.2 * np.cos(7 * grid)], axis=1)
    screw = descriptors(rng, 1).repeat(20, axis=0)
    assert len(matching.match(screw, screw)) == 0
    shuffle = rng.permutation(20)
    rows = {0: np.arange(20) + 5, 1: np.arange(20) + 9}
    found = guided_matching.match_guided(
        [(0, 1)],
        [screw, screw],
        [rows[0], rows[1]],
        {0: rays(cameras[0], points), 1: rays(cameras[1], points)[shuffle]},
        cameras,
        1,
        lambda done, total, note: None,  # noqa: ARG005 -- a progress listener
    )
    matches = found[0, 1].astype(int) - [5, 9]
    assert len(matches) == 20
    assert np.array_equal(shuffle[matches[:, 1]], matches[:, 0])


def test_what_is_far_from_the_line_never_matches() -> None:
    rng = np.random.default_rng(1)
    cameras = two_cameras(rng)
    points = rng.uniform(-1, 1, (30, 3)) + np.array([0, 0, 4])
    data = descriptors(rng, 30)
    second = rays(cameras[1], points)
    second[10:20, 1] += 3.5 / FOCAL  # the lines run nearly level
    second[20:, 1] += 1.0 / FOCAL
    told: list[str] = []
    found = guided_matching.match_guided(
        [(0, 1)],
        [data, data],
        [np.arange(30)] * 2,
        {0: rays(cameras[0], points), 1: second},
        cameras,
        2,
        lambda done, total, note: told.append(f"{done}/{total} {note}"),
    )
    kept = [*range(10), *range(20, 30)]
    assert found[0, 1].tolist() == [[k, k] for k in kept]
    assert told == ["1/1 20 matches in 1 pairs along epipolar lines"]


def test_views_without_key_points_match_nothing() -> None:
    cameras = two_cameras(np.random.default_rng(2))
    empty = np.zeros((0, 128), np.uint8)
    found = guided_matching.match_guided(
        [(0, 1)],
        [empty, descriptors(np.random.default_rng(0), 4)],
        [np.zeros(0, np.int64), np.arange(4)],
        {0: np.zeros((0, 2)), 1: np.zeros((4, 2))},
        cameras,
        1,
        lambda done, total, note: None,  # noqa: ARG005 -- a progress listener
    )
    assert found == {}
