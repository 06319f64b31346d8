"""Specification of matching along epipolar lines of known poses."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext

import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics, rotation_of
from mattgs_ops.progress import no_progress
from mattgs_ops.sfm.colmap import guided_matching, matching
from mattgs_ops.sfm.colmap.guided_matching import Guide, homogeneous

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
    guide = Guide([screw, screw], [rows[0], rows[1]])
    guide.settle(cameras, {0: rays(cameras[0], points), 1: rays(cameras[1], points)[shuffle]})
    found = guide.finish(no_progress)
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
    guide = Guide([data, data], [np.arange(30)] * 2)
    guide.settle(cameras, {0: rays(cameras[0], points), 1: second})
    found = guide.finish(lambda done, total, note: told.append(f"{done}/{total} {note}"))
    kept = [*range(10), *range(20, 30)]
    assert found[0, 1].tolist() == [[k, k] for k in kept]
    assert told == ["1/1 20 matches in 1 pairs along epipolar lines"]


def test_views_without_key_points_match_nothing() -> None:
    cameras = two_cameras(np.random.default_rng(2))
    empty = np.zeros((0, 128), np.uint8)
    guide = Guide(
        [empty, descriptors(np.random.default_rng(0), 4)], [np.zeros(0, np.int64), np.arange(4)]
    )
    guide.settle(cameras, {0: np.zeros((0, 2)), 1: np.zeros((4, 2))})
    assert guide.pairs == 1
    assert guide.finish(no_progress) == {}


def growing(views: int) -> tuple[dict[int, Camera], dict[int, NDArray[np.float64]]]:
    """Return cameras in a row, one step apart, and what each sees of the same points."""
    points = np.random.default_rng(3).uniform(-1, 1, (40, 3)) + np.array([0, 0, 4])
    cameras = {k: Camera(INTRINSICS, np.eye(3), np.array([-0.2 * k, 0, 0])) for k in range(views)}
    return cameras, {k: rays(camera, points) for k, camera in cameras.items()}


def first(views: dict[int, Camera], count: int) -> dict[int, Camera]:
    return {k: views[k] for k in range(count)}


@pytest.mark.parametrize("helpers", [0, 1, 3])
def test_pairs_are_matched_with_the_poses_of_the_moment_they_settled(helpers: int) -> None:
    """Poses seen later are planted wrong: only pairs that settled late lose their matches."""
    cameras, seen = growing(5)
    data = [descriptors(np.random.default_rng(0), 40)] * 5
    wrong = {k: Camera(INTRINSICS, np.eye(3), c.translation[[1, 0, 2]]) for k, c in cameras.items()}
    with ThreadPoolExecutor(helpers) if helpers else nullcontext() as pool:
        guide = Guide(data, [np.arange(40)] * 5, pool)
        guide.see(first(cameras, 3), seen)
        assert guide.pairs == 0  # nobody has been there twice
        guide.see(first(cameras, 4), seen)
        assert guide.pairs == 3
        guide.settle(wrong, seen)
        assert guide.pairs == 10
        found = guide.finish(no_progress)
    exact = [pair for pair, matches in found.items() if len(matches) == 40]
    assert exact == [(0, 1), (0, 2), (1, 2)]
    assert list(found) == sorted(found)
    assert guide.spent() > 0


def test_the_pairs_of_another_model_are_matched_anew() -> None:
    cameras, seen = growing(4)
    wrong = {k: Camera(INTRINSICS, np.eye(3), c.translation[[1, 0, 2]]) for k, c in cameras.items()}
    for same, told in ((True, 3), (False, 6)):
        guide = Guide([descriptors(np.random.default_rng(0), 40)] * 4, [np.arange(40)] * 4)
        guide.see(first(wrong, 3), seen)
        guide.see(first(wrong, 3), seen)
        guide.settle(cameras, seen, same=same)
        found = guide.finish(no_progress)
        assert sum(len(m) == 40 for m in found.values()) == told
    guide = Guide([descriptors(np.random.default_rng(0), 40)] * 4, [np.arange(40)] * 4)
    guide.see(first(wrong, 3), seen)
    guide.see(wrong, seen)
    guide.see(first(cameras, 2), seen)  # a model that starts again
    assert guide.pairs == 0
    guide.settle({0: cameras[0], 2: cameras[2]}, seen)  # a view that the mapper gave up
    assert list(guide.finish(no_progress)) == [(0, 2)]
