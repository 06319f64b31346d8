"""Of several networks' maps the mean stays, unless one network's are surely better."""

import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera
from mattgs_ops.object_masks import silhouettes
from mattgs_ops.object_masks.own_maps import choose
from tests.mattgs_ops.object_masks.ball import leaking, orbit, truth

ALL = [True] * 10


def photo(camera: Camera) -> np.ndarray:
    """Return a bright ball on dark ground [H, W, 3]."""
    return np.where(truth(camera)[..., None] > 0, 200, 40).astype(np.uint8).repeat(3, axis=2)


def test_one_networks_maps_are_chosen_where_they_are_surely_better() -> None:
    cameras = orbit()
    photos = [photo(camera) for camera in cameras]
    right = [truth(camera) for camera in cameras]
    wrong = leaking([truth(camera) for camera in cameras])
    found = choose([wrong, wrong, right], cameras, photos, ALL)
    assert found.chosen == 2
    assert found.maps is right
    assert found.worths[0] == found.worths[1] < found.worths[2] <= 1


def test_the_mean_stays_where_no_network_is_surely_better() -> None:
    cameras = orbit()
    photos = [photo(camera) for camera in cameras]
    right = [truth(camera) for camera in cameras]
    wrong = leaking([truth(camera) for camera in cameras])
    assert choose([right, wrong], cameras, photos, ALL).chosen == 0
    assert choose([right, right], cameras, photos, ALL).chosen == 0
    one_better = [*wrong[:1], *right[1:]]  # a single view cannot tell
    found = choose([one_better, right], cameras, photos, ALL)
    assert found.worths[0] < found.worths[1]
    assert found.chosen == 0


def test_held_out_views_are_not_compared() -> None:
    cameras = orbit()
    photos = [photo(camera) for camera in cameras]
    right = [truth(camera) for camera in cameras]
    wrong = leaking([truth(camera) for camera in cameras])
    trained = [index < 6 for index in range(len(cameras))]
    better_when_held_out = [*right[:6], *wrong[6:]], [*wrong[:6], *right[6:]]
    assert choose(better_when_held_out, cameras, photos, trained).chosen == 0


@pytest.mark.parametrize("with_object", [0, 1])
def test_maps_that_share_no_object_are_worth_nothing(with_object: int) -> None:
    cameras = orbit()
    photos = [photo(camera) for camera in cameras]
    right = [truth(camera) for camera in cameras]
    empty = [*right[:with_object], *(np.zeros_like(soft) for soft in right[with_object:])]
    found = choose([empty, right], cameras, photos, ALL)
    assert (found.chosen, found.worths[0]) == (1, 0.0)


def test_a_single_network_is_its_own_choice() -> None:
    cameras = orbit()
    maps = [truth(camera) for camera in cameras]
    found = choose([maps], cameras, [photo(camera) for camera in cameras], ALL)
    assert found.maps is maps
    assert found.chosen == 0
    assert found.outlines is not None
    again = silhouettes.predict(cameras, maps, ALL)
    assert again is not None
    assert found.outlines.agreement == again.agreement
