"""Specification of matching: pairs, nearest neighbours, and what is added by masked matches."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap import _descriptors, matching


def descriptors(rng: np.random.Generator, count: int) -> NDArray[np.uint8]:
    """Make vectors like SIFT's: sparse, of length 512, rounded."""
    raw = rng.random((count, 128)) ** 4
    return np.rint(raw / np.linalg.norm(raw, axis=1, keepdims=True) * 512).astype(np.uint8)


def noisy(data: NDArray[np.uint8], rng: np.random.Generator, sigma: float) -> NDArray[np.uint8]:
    return np.clip(np.rint(data + rng.normal(0, sigma, data.shape)), 0, 255).astype(np.uint8)


def slow_match(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> set[tuple[int, int]]:
    """Match by the definition, one descriptor at a time, in double precision."""

    def nearest(d: NDArray[np.uint8], among: NDArray[np.uint8]) -> int | None:
        angles = [
            np.arccos(min(1.0, float(d.astype(np.int64) @ e.astype(np.int64)) / 512**2))
            for e in among
        ]
        order = np.argsort(angles, kind="stable")
        best, second_best = angles[order[0]], angles[order[1]]
        return int(order[0]) if best <= 0.7 and best < 0.8 * second_best else None

    there = {i: nearest(d, second) for i, d in enumerate(first)}
    back = {j: nearest(d, first) for j, d in enumerate(second)}
    return {(i, j) for i, j in there.items() if j is not None and back[j] == i}


@pytest.mark.parametrize("sigma", [2.0, 12.0, 20.0])
def test_matches_are_mutual_nearest_neighbours_that_pass_the_ratio_test(sigma: float) -> None:
    rng = np.random.default_rng(0)
    first = descriptors(rng, 70)
    second = np.concatenate([noisy(first[::2], rng, sigma), descriptors(rng, 40)])
    second = np.concatenate([second, noisy(first[:6], rng, sigma)])  # doubles: ambiguous
    found = matching.match(first, second)
    assert found.dtype == np.uint32
    assert {tuple(m) for m in found.tolist()} == slow_match(first, second)
    assert 10 < len(found) <= 40


def test_matching_is_symmetric_and_leaves_its_input_alone() -> None:
    rng = np.random.default_rng(1)
    first = descriptors(rng, 50)
    second = noisy(first, rng, 8.0)[::-1].copy()
    before = first.copy(), second.copy()
    there, back = matching.match(first, second), matching.match(second, first)
    assert sorted(map(tuple, there.tolist())) == sorted((i, j) for j, i in back.tolist())
    assert np.array_equal(first, before[0])
    assert np.array_equal(second, before[1])


@pytest.mark.parametrize("counts", [(1, 2), (6, 16), (7, 33), (50, 65), (13, 128)])
@pytest.mark.parametrize("name", _descriptors.instruction_sets())
def test_every_instruction_set_finds_the_two_largest_products(
    name: str, counts: tuple[int, int]
) -> None:
    rng = np.random.default_rng(4)
    rows, columns = (rng.integers(0, 256, (n, 128), dtype=np.uint8) for n in counts)
    columns[len(columns) // 2 :] = columns[: -(-len(columns) // 2)][::-1]  # equal products
    rows[0], columns[:] = 0, np.where(rng.random((counts[1], 1)) < 0.1, 0, columns)
    column, best, second = (np.empty(counts[0], np.int32) for _ in range(3))
    _descriptors.nearest(rows, columns, column, best, second, name)
    products = rows.astype(np.int64) @ columns.T.astype(np.int64)
    assert np.array_equal(column, products.argmax(axis=1))  # the first of several
    ordered = np.sort(products, axis=1)
    assert np.array_equal(best, ordered[:, -1])
    assert np.array_equal(second, ordered[:, -2])


def test_what_does_not_fit_together_is_refused() -> None:
    data = descriptors(np.random.default_rng(5), 4)
    short = np.empty(3, np.int32)
    with pytest.raises(ValueError, match="unexpected length"):
        _descriptors.nearest(data, data, short, short, short)
    out = np.empty(4, np.int32)
    with pytest.raises(ValueError, match="not available"):
        _descriptors.nearest(data, data, out, out, out, "abacus")


@pytest.mark.parametrize("counts", [(0, 5), (5, 0), (1, 5), (5, 1), (0, 0)])
def test_too_few_descriptors_match_nothing(counts: tuple[int, int]) -> None:
    rng = np.random.default_rng(2)
    found = matching.match(descriptors(rng, counts[0]), descriptors(rng, counts[1]))
    assert found.shape == (0, 2)


def test_few_views_are_matched_exhaustively_and_more_by_looks() -> None:
    rng = np.random.default_rng(3)
    data = [descriptors(rng, 4) for _ in range(40)]
    everything = 40 * 39 // 2
    assert len(matching.choose_pairs(data[:25], SfmConfig())) == 25 * 24 // 2
    assert len(matching.choose_pairs(data, SfmConfig(exhaustive_limit=40))) == everything
    assert len(matching.choose_pairs(data, SfmConfig(matcher="exhaustive"))) == everything
    assert matching.choose_pairs(data, SfmConfig()) == matching.choose_pairs(
        data, SfmConfig(matcher="similar")
    )
    sequence = matching.choose_pairs(data, SfmConfig(matcher="sequential"))
    assert {(0, 1), (0, 10), (0, 16), (0, 32), (7, 39)} <= set(sequence)
    assert not {(0, 11), (0, 15), (0, 33)} & set(sequence)


def test_photos_in_no_order_are_compared_with_those_that_look_most_alike() -> None:
    rng = np.random.default_rng(6)
    places = [descriptors(rng, 40) for _ in range(4)]
    data = [noisy(places[number % 4], rng, 4.0) for number in range(32)]
    alike = {(i, j) for i in range(32) for j in range(i + 1, 32) if i % 4 == j % 4}
    assert set(matching.choose_pairs(data, SfmConfig())) == alike


def test_many_photos_are_a_sequence_where_they_are_followed_by_one_that_looks_alike() -> None:
    rng = np.random.default_rng(8)
    seen = descriptors(rng, 6 * 30 + 24)
    walk = [noisy(seen[6 * number : 6 * number + 24], rng, 4.0) for number in range(30)]
    many = SfmConfig(exhaustive_limit=10, similar_limit=20)

    def is_matched_as(matcher: str, photos: list[NDArray[np.uint8]]) -> bool:
        same = many.model_copy(update={"matcher": matcher})
        return matching.choose_pairs(photos, many) == matching.choose_pairs(photos, same)

    assert is_matched_as("sequential", walk)
    assert not is_matched_as("similar", walk)
    by_other_names = [walk[number] for number in rng.permutation(30)]
    assert is_matched_as("similar", by_other_names)
    assert not is_matched_as("sequential", by_other_names)


def test_a_sequence_closes_its_loop_by_looks() -> None:
    # view 59 sees what view 0 saw: farther than any step of the sequence that starts at 0
    rng = np.random.default_rng(4)
    data = [descriptors(rng, 30) for _ in range(60)]
    data[59] = noisy(data[0], rng, 4.0)
    assert (0, 59) not in matching.sequential(60)
    assert (0, 59) in matching.choose_pairs(data, SfmConfig(matcher="sequential"))
    assert (0, 59) in matching.choose_pairs(data, SfmConfig(matcher="similar"))


def test_views_with_known_poses_are_compared_when_they_look_the_same_way() -> None:
    intrinsics = Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0)
    cameras = []
    for k in range(8):  # a full turn in steps of 45 degrees
        a = k * np.pi / 4
        forward = np.array([-np.cos(a), -np.sin(a), 0])
        right = np.array([-np.sin(a), np.cos(a), 0])
        rotation = np.stack([right, np.cross(forward, right), forward])
        cameras.append(Camera(intrinsics, rotation, np.array([0, 0, 2.0])))
    pairs = set(matching.facing(dict(enumerate(cameras))))
    assert pairs == {(k, k + 1) for k in range(7)} | {(0, 7)}
    some = {k: cameras[k] for k in (0, 1, 3, 7)}  # unregistered views are left out
    assert matching.facing(some) == [(0, 1), (0, 7)]


def test_matches_are_added_without_using_a_key_point_twice() -> None:
    def rows(pairs: list[list[int]]) -> NDArray[np.uint32]:
        return np.array(pairs, dtype=np.uint32)

    first = {(0, 1): rows([[0, 0], [2, 9], [5, 3]])}
    # 2 is known to the first view's matches, 3 to the second's
    second = {(0, 1): rows([[2, 1], [4, 3], [6, 5], [8, 7]]), (1, 2): rows([[3, 0]])}
    both = matching.merged(first, second)
    assert both[0, 1].tolist() == [[0, 0], [2, 9], [5, 3], [6, 5], [8, 7]]
    assert both[1, 2].tolist() == [[3, 0]]
    assert len(first[0, 1]) == 3
    assert list(first) == [(0, 1)]
