"""Traced rooms: the object's place is free, cameras stand in free air, all follows from a seed."""

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the `captures` extra is not installed")

from mattgs_ops.segment.training_images.textures import Bank
from mattgs_ops.segment.training_images.traced.rooms import ORBIT, lay_room, put_random
from mattgs_ops.synthetic.surfaces.materials import Stage
from mattgs_ops.synthetic.tracer import choose_variant

BANK = Bank(1, per_maker=1)
TALLEST = 30.0  # centimetres: what stands on the table beside the object


@pytest.fixture(scope="module", autouse=True)
def _variant() -> None:
    choose_variant("scalar_rgb")


@pytest.mark.parametrize("seed", range(6))
def test_nothing_but_low_things_stands_where_cameras_are(seed: int) -> None:
    room = lay_room(np.random.default_rng(seed), BANK)
    assert room.lowest in (8.0, -6.0)
    assert room.aperture == 0 or 0.4 <= room.aperture <= 1.6
    for mesh, _, _, own in room.ground.stage.merged():
        assert not own  # a room is ground, the things in it included
        away = np.linalg.norm(mesh.vertices[:, :2], axis=1)
        near = mesh.vertices[(away < 0.7 * ORBIT) & (mesh.vertices[:, 2] < 85)]
        assert near.size == 0 or near[:, 2].max() < TALLEST
        at_foot = mesh.vertices[(away < 10.0) & (mesh.vertices[:, 2] < 85)]
        assert at_foot.size == 0 or at_foot[:, 2].max() <= room.ground.top


@pytest.mark.parametrize("seed", range(5))
def test_an_object_stands_on_what_carries_it_within_its_points(seed: int) -> None:
    stage = Stage()
    points = put_random(stage, 0.04, 12.0, BANK, np.random.default_rng(seed))
    vertices = np.concatenate([mesh.vertices for mesh, _, _, _ in stage.merged()])
    assert all(own for _, _, _, own in stage.merged())
    assert vertices[:, 2].min() > -0.6  # a rounded foot may reach a little into the ground
    assert np.abs(points.mean(0) - vertices.mean(0)).max() < 5.0
    assert np.abs(np.ptp(points, axis=0) - np.ptp(vertices, axis=0)).max() < 3.0


def test_rooms_follow_from_their_seed_and_differ() -> None:
    first, again, other = (
        lay_room(np.random.default_rng(seed), BANK).ground.stage.merged() for seed in (3, 3, 4)
    )
    assert [len(m.vertices) for m, _, _, _ in first] == [len(m.vertices) for m, _, _, _ in again]
    assert np.array_equal(first[0][0].vertices, again[0][0].vertices)
    assert not np.array_equal(first[0][0].vertices, other[0][0].vertices)
