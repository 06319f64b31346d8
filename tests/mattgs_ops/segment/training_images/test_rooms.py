"""Rooms surround the object: something is behind it everywhere, and none of it is the object."""

import numpy as np
import pytest

from mattgs_ops.segment.network.train_config import WorldConfig
from mattgs_ops.segment.training_images import composites
from mattgs_ops.segment.training_images.composites import Composites, room_scene
from mattgs_ops.segment.training_images.draw import Camera, Canvas, Light
from mattgs_ops.segment.training_images.rooms import (
    AWAY,
    furniture,
    open_window,
    paint_room,
    patch_of,
    room_light,
    room_walls,
    support,
)
from mattgs_ops.segment.training_images.solids import rotation
from mattgs_ops.segment.training_images.textures import Bank

SIDE = 64
EYE = np.array([0, -3.0, 1.0])
POINTS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.4, 0.4) for z in (0.0, 0.8)])
UNPAINTED = (1, 2, 3)  # a colour that nothing is painted in by chance


def empty_canvas(bank: Bank, seed: int) -> Canvas:
    rng = np.random.default_rng(seed)
    camera = Camera.facing(EYE, np.array([0, 0, 0.4]), SIDE, 1.0, 1.0, 0.0)
    canvas = Canvas(SIDE, camera, Light.random(rng), bank, rng)
    canvas.image[:] = UNPAINTED
    return canvas


@pytest.mark.parametrize("seed", range(6))
def test_a_room_covers_the_whole_photo_and_none_of_it_is_object(bank: Bank, seed: int) -> None:
    canvas = empty_canvas(bank, seed)
    paint_room(canvas, POINTS)
    bare = (canvas.image == UNPAINTED).all(-1).mean()
    assert bare < 0.01
    assert not canvas.mask.any()


def test_walls_look_inwards_and_enclose_object_and_camera() -> None:
    rng = np.random.default_rng(3)
    half, drop = np.array([4.0, 5.0]), 1.5
    faces = room_walls(rng, half, (-drop, 3.0), rotation(rng))
    assert len(faces) == 6
    for face in faces:
        for inside in (np.zeros(3), EYE):
            assert (inside - face.contours[0].mean(0)) @ face.normal > 0
    heights = sorted(face.contours[0][:, 2].mean() for face in faces[4:])
    assert heights == pytest.approx([-drop, 3.0])


def test_what_hangs_on_a_wall_lies_on_it() -> None:
    rng = np.random.default_rng(4)
    wall = room_walls(rng, np.array([4.0, 5.0]), (-1.0, 4.0), np.eye(3))[0]
    for _ in range(20):
        patch = patch_of(rng, wall, (0.1, 0.6))
        before = (patch - wall.contours[0][0]) @ wall.normal
        assert np.allclose(before, 0.02)
        assert (patch.min(0) >= wall.contours[0].min(0) - 0.03).all()
        assert (patch.max(0) <= wall.contours[0].max(0) + 0.03).all()


def test_a_window_is_brighter_than_the_room_and_never_darkens_it(bank: Bank) -> None:
    canvas = empty_canvas(bank, 5)
    canvas.image[:] = 90
    walls = room_walls(canvas.rng, np.array([3.0, 4.0]), (-1.0, 4.0), np.eye(3))
    behind = max(walls[:4], key=lambda wall: float(wall.contours[0][:, 1].mean()))
    for _ in range(4):
        open_window(canvas, behind)
    assert canvas.image.max() > 170
    assert canvas.image.min() >= 89


def test_furniture_stands_clear_of_the_object_and_of_the_camera() -> None:
    rng = np.random.default_rng(6)
    count = 0
    for _ in range(10):
        for faces in furniture(rng, np.array([6.0, 6.0]), 1.0, np.eye(3), EYE):
            points = np.concatenate([face.contours[0] for face in faces])
            middle = points.mean(0)[:2]
            assert np.linalg.norm(middle) > 0.5 * AWAY
            count += 1
    assert count > 10


@pytest.mark.parametrize("seed", range(8))
def test_a_support_reaches_the_objects_foot_and_not_above_it(seed: int) -> None:
    faces = support(np.random.default_rng(seed), POINTS, 1.5)
    points = np.concatenate([face.contours[0] for face in faces])
    assert points[:, 2].max() == pytest.approx(0, abs=1e-9)
    reach = np.abs(POINTS[:, :2]).max()
    assert np.abs(points[:, :2]).max() > 0.9 * reach, "the object does not hang in the air"


def test_lamps_at_times_stand_behind_the_object() -> None:
    lights = [room_light(np.random.default_rng(seed), EYE) for seed in range(60)]
    behind = [
        light for light in lights if light.direction[:2] @ EYE[:2] < 0 and light.ambient < 0.35
    ]
    assert 5 < len(behind) < 50
    assert all(light.direction[2] > 0 for light in lights), "shadows fall downwards"


def test_a_rooms_object_is_the_mask(bank: Bank) -> None:
    shares = []
    for seed in range(6):
        image, mask = room_scene(np.random.default_rng(seed), SIDE, bank, WorldConfig())
        assert image.shape == (SIDE, SIDE, 3)
        shares.append((mask > 127).mean())
    assert min(shares) > 0.005
    assert max(shares) < 0.9


def test_composites_show_rooms_as_often_as_asked(
    bank: Bank, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[int] = []

    def counted(_rng: np.random.Generator, side: int, *_: object) -> tuple[np.ndarray, np.ndarray]:
        drawn.append(side)
        return np.zeros((side, side, 3), np.uint8), np.zeros((side, side), np.uint8)

    monkeypatch.setattr(composites, "room_scene", counted)
    world = WorldConfig(plain=0.2, walls=0.1, rooms=0.7)
    source = Composites(0, 16, bank, world=world)
    for index in range(60):
        source.sample(index)
    assert 30 < len(drawn) < 54
