"""Which pairs contradict their whole photos, and which poses explain the matches of an object."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.sfm.colmap.moving_object import (
    FEWEST_MATCHES,
    ObjectMatches,
    epipolar_error,
    explains_more,
    object_matches,
    share_contradicting,
    shares_explained,
)

LENS = Intrinsics(400, 300, 500.0, 500.0, 200.0, 150.0)
ALL = np.stack([np.arange(60)] * 2, axis=1).astype(np.uint32)  # key point k matches key point k
INSIDE = (np.arange(60) < 40, np.arange(60) < 40)  # the first forty lie on the object


def turned(degrees: float) -> Camera:
    """Look at the origin from a distance of 5, from another side."""
    rotation = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return Camera(LENS, rotation, np.array([0.0, 0.0, 5.0]))


def rays(camera: Camera, points: np.ndarray) -> np.ndarray:
    seen = points @ camera.rotation.T + camera.translation
    return np.asarray(seen[:, :2] / seen[:, 2:])


def refuse(_: np.ndarray) -> np.ndarray:
    raise AssertionError("no geometry of its own is needed")


def test_whole_photos_that_explain_the_object_are_not_denied() -> None:
    found = object_matches(ALL, ALL[10:], INSIDE, refuse)
    assert found is not None
    assert not found.contradicts
    assert found.matches.tolist() == ALL[10:40].tolist()


def test_whole_photos_are_denied_by_what_the_object_alone_explains() -> None:
    asked = []

    def verify(matches: np.ndarray) -> np.ndarray:
        asked.append(matches.tolist())
        return matches[:30]

    found = object_matches(ALL, ALL[26:], INSIDE, verify)  # 14 of its 40, of which 4 are in both
    assert asked == [ALL[:40].tolist()]
    assert found is not None
    assert found.contradicts
    assert len(found.matches) == 30


def test_a_geometry_that_shares_half_of_its_matches_with_the_whole_photos_is_theirs() -> None:
    found = object_matches(ALL, ALL[22:], INSIDE, lambda matches: matches[10:])
    assert found is not None
    assert not found.contradicts  # the whole photos' explains 18 of its 30


def test_matches_that_nothing_explains_say_nothing() -> None:
    too_few = FEWEST_MATCHES - 1
    assert object_matches(ALL, ALL[40:], INSIDE, lambda matches: matches[:too_few]) is None
    nowhere = (np.zeros(60, bool), np.zeros(60, bool))
    assert object_matches(ALL, ALL, nowhere, refuse) is None
    assert object_matches(ALL[:too_few], ALL[:3], INSIDE, refuse) is None


@pytest.mark.parametrize(
    ("alone", "whole", "taken"),
    [
        (0.99, 0.64, True),
        (0.81, 0.64, False),  # of 36 that were left 19 still are
        (1.0, 0.99, True),
        (0.5, None, True),  # whole photos gave no poses
        (None, 0.2, False),
        (None, None, False),
    ],
)
def test_the_object_alone_must_explain_half_of_what_whole_photos_leave(
    alone: float | None, whole: float | None, taken: bool
) -> None:
    assert explains_more(alone, whole) is taken


def test_the_share_is_of_pairs_that_show_the_object() -> None:
    found = {(0, k): ObjectMatches(ALL, contradicts=k < 3) for k in range(1, 6)}
    assert share_contradicting(found) == 0.4
    assert share_contradicting({}) is None


def test_the_error_is_a_distance_from_epipolar_lines_in_pixels() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    first, second = turned(0), turned(20)
    here, there = rays(first, points), rays(second, points)
    np.testing.assert_allclose(epipolar_error(first, second, here, there), 0, atol=1e-9)
    # cameras turned about y have nearly level lines: a match three pixels too high is off by
    # three pixels, which Sampson's distance shares between both photos
    shifted = there + np.array([0, 3 / LENS.fy])
    error = epipolar_error(first, second, here, shifted)
    np.testing.assert_allclose(error, 3 / np.sqrt(2), rtol=0.1)
    assert np.isinf(epipolar_error(first, first, here, here)).all()


def test_poses_explain_the_pairs_whose_matches_lie_on_their_lines() -> None:
    points = np.random.default_rng(1).uniform(-1, 1, (60, 3))
    cameras = {0: turned(0), 1: turned(20), 2: turned(40)}
    right = {view: rays(camera, points) for view, camera in cameras.items()}
    wrong = right | {2: right[2] + np.array([0.0, 20.0]) / LENS.fy}
    found = {
        pair: ObjectMatches(ALL, contradicts=False) for pair in [(0, 1), (0, 2), (1, 2), (2, 3)]
    }
    # view 3 has no pose
    assert shares_explained(found, cameras, lambda view, rows: right[view][rows]) == (0.75, 1.0)
    assert shares_explained(found, cameras, lambda view, rows: wrong[view][rows]) == (0.25, 1 / 3)
    untested = shares_explained({}, cameras, lambda view, rows: right[view][rows])
    assert untested == (None, None)
