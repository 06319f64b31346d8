"""Photos of another side with the same print, turned by a quarter, do not join the others."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops import sfm
from mattgs_ops.capture.camera import Camera
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm import look_alikes
from mattgs_ops.sfm.colmap.features import Pair
from mattgs_ops.sfm.colmap.matching import LEAST_MATCHES, Verified
from mattgs_ops.sfm.rolled_groups import groups_of, on_their_side, vertical, without_ties
from tests.mattgs_ops import conftest as box

NOTHING = np.zeros((0, 2), np.uint32)
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def tied(*pairs: Pair, by: int = LEAST_MATCHES) -> dict[Pair, Verified]:
    return {pair: Verified(None, NOTHING, None, by) for pair in pairs}


def all_of(views: range) -> dict[Pair, Verified]:
    return tied(*((a, b) for a in views for b in views if a < b))


def turned(camera: Camera, rotation: NDArray[np.float64]) -> Camera:
    return Camera(camera.intrinsics, rotation @ camera.rotation, rotation @ camera.translation)


def test_three_pairs_tie_two_groups_and_two_may_match_falsely() -> None:
    groups = all_of(range(5)) | all_of(range(5, 9))
    two = tied((0, 5), (3, 7))
    assert groups_of(groups | two) == [{0, 1, 2, 3, 4}, {5, 6, 7, 8}]
    assert groups_of(groups | two | tied((4, 8))) == [set(range(9))]
    assert groups_of(groups | two | tied((4, 8), by=LEAST_MATCHES - 1)) == groups_of(groups)
    assert groups_of(groups | tied((0, 5), by=3 * LEAST_MATCHES)) == [set(range(9))]
    assert groups_of(groups | tied((0, 5), by=3 * LEAST_MATCHES - 1)) == groups_of(groups)
    assert groups_of({}) == []


def test_photos_along_a_way_that_share_with_two_neighbours_are_one_group() -> None:
    steps = tied(*((view, view + d) for view in range(12) for d in (1, 2)))
    (first, *ends) = groups_of(steps)
    assert first >= set(range(1, 12))
    assert all(len(end) == 1 for end in ends)


def test_the_vertical_is_that_of_cameras_held_upright() -> None:
    up = vertical(box.orbit(9))
    assert up is not None
    assert abs(up[2]) == pytest.approx(1)
    assert vertical(box.orbit(4, np.radians(5))) is None, "one direction tells no vertical"
    mixed = [turned(c, QUARTER) if k % 2 else c for k, c in enumerate(box.orbit(9))]
    assert vertical(mixed) is None, "which way up do they hold the camera?"


def test_a_group_is_on_its_side_where_all_its_views_are() -> None:
    cameras = dict(enumerate(box.orbit(12)))
    groups = [set(range(8)), set(range(8, 12))]
    assert on_their_side(cameras, groups) == []
    cameras |= {view: turned(cameras[view], QUARTER) for view in range(8, 12)}
    assert on_their_side(cameras, groups) == [groups[1]]
    assert on_their_side({v: cameras[v] for v in range(11)}, groups) == [groups[1]]
    assert on_their_side({v: cameras[v] for v in range(10)}, groups) == [], "two may be so turned"
    assert on_their_side(cameras, groups[:1]) == []
    parts = [set(range(8)), {8, 9, 10}, {11}]
    assert on_their_side(cameras, parts) == parts[1:], "one beside three is of them"
    cameras[8] = box.orbit(12)[8]
    assert on_their_side(cameras, groups) == []


def test_pairs_between_groups_are_left_out() -> None:
    pairs = tied((0, 1), (1, 2), (2, 3), (0, 4), (4, 5))
    assert set(without_ties(pairs, [{0, 1}])) == {(0, 1), (2, 3), (4, 5)}


def with_one_print_on_two_sides(seed: int) -> list[NDArray[np.float32]]:
    """Print a box whose side to the right repeats its front's print, turned by a quarter."""
    rng = np.random.default_rng(seed)
    textures = [box.print_texture(rng, 1024, 8000)]
    textures += [box.print_texture(rng, 256, 650) for _ in range(6)]
    shown = 179  # pixels of the print that the sides show of its height
    front = textures[2][:shown, :shown]  # rows go to the right as one looks at it, columns up
    right = np.rot90(front)[::-1]  # there rows go to the left
    textures[4][:shown, :shown] = right
    return textures


def test_a_print_that_repeats_turned_places_no_photo(tmp_path: Path) -> None:
    """From all pairs all views register, those of one side 77 degrees away."""
    around = box.orbit(36)
    cameras = [*around[15:21], *around[26:31]]  # before the front, and before the side to the right
    capture = box.photographed_by(tmp_path / "in", with_one_print_on_two_sides(4), cameras)
    scene = sfm.reconstruct(capture, tmp_path / "in" / "masks", SfmConfig(), tmp_path / "out")
    assert scene.extra["pose_error"]["views"] == 6
    assert scene.extra["pose_error"]["rotation_deg_max"] < 1
    (told,) = [text for text in scene.extra["warnings"] if look_alikes.ON_THEIR_SIDE in text]
    assert told.startswith("0006.jpg, 0007.jpg, 0008.jpg, 0009.jpg, 0010.jpg lie on their side")
    assert scene.extra["poses_in_doubt"]
