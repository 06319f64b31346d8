"""Plain grounds look like what they are called."""

import numpy as np
import pytest

from mattgs_ops.segment.training_images.composites import draw_in_order
from mattgs_ops.segment.training_images.draw import Camera, Canvas, Light
from mattgs_ops.segment.training_images.plain_grounds import (
    KINDS,
    Kind,
    ground_light,
    like_ground,
    paint_ground,
    random_ground,
    turntable,
)
from mattgs_ops.segment.training_images.solids import box
from mattgs_ops.segment.training_images.textures import Bank

SIDE = 64
EYE = np.array([0, -3.0, 2.0])


def painted(bank: Bank, kind: Kind, colour: tuple[float, float, float], seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    camera = Camera.facing(EYE, np.zeros(3), SIDE, 1.0, 1.0, 0.0)
    canvas = Canvas(SIDE, camera, ground_light(rng, kind, EYE), bank, rng)
    paint_ground(canvas, kind, colour)
    return canvas.image.astype(float)


def test_black_cloth_is_dark_and_a_sweep_is_bright(bank: Bank) -> None:
    for seed in range(4):
        assert painted(bank, "black", (0.03, 0.03, 0.03), seed).mean() < 25
        assert painted(bank, "sweep", (0.9, 0.9, 0.9), seed).mean() > 130


def test_a_flash_leaves_the_far_wall_dark(bank: Bank) -> None:
    shares = []
    for seed in range(6):
        image = painted(bank, "flash", (0.6, 0.6, 0.6), seed)
        shares.append(image[:6].mean() / max(1.0, image[40:].mean()))
    assert np.median(shares) < 0.6


def test_a_flash_shines_from_the_camera_and_other_lamps_from_above() -> None:
    rng = np.random.default_rng(1)
    flash = ground_light(rng, "flash", EYE)
    assert flash.direction @ EYE / np.linalg.norm(EYE) > 0.9
    assert flash.ambient < 0.25
    other: Light = ground_light(rng, "table", EYE)
    assert np.linalg.norm(other.direction) == pytest.approx(1)


def test_colours_like_the_ground_are_near_it_but_not_it() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        for colour in like_ground(rng, (0.5, 0.5, 0.5)):
            away = np.abs(np.array(colour) - 0.5).mean()
            assert 0.02 < away < 0.3


def test_every_kind_is_drawn() -> None:
    rng = np.random.default_rng(3)
    assert {random_ground(rng)[0] for _ in range(200)} == set(KINDS)


def test_a_turntable_is_wider_than_the_object_and_below_it() -> None:
    rng = np.random.default_rng(4)
    points = np.array([[0.4, 0.3, 0.0], [-0.5, 0.1, 0.7], [0.0, -0.2, 1.0]])
    for _ in range(10):
        corners = np.concatenate([face.contours[0] for face in turntable(rng, points)])
        assert np.linalg.norm(corners[:, :2], axis=1).max() > np.linalg.norm([0.5, 0.1])
        assert corners[:, 2].max() == 0
        assert corners[:, 2].min() < 0


def test_a_turntable_is_drawn_and_no_part_of_the_mask(bank: Bank) -> None:
    drawn = {}
    for share in (0.0, 1.0):
        rng = np.random.default_rng(5)
        camera = Camera.facing(EYE, np.zeros(3), SIDE, 1.0, 1.0, 0.0)
        canvas = Canvas(SIDE, camera, Light.random(rng), bank, rng)
        cube = box(np.array([0, 0, 0.3]), np.full(3, 0.6), (0.9, 0.1, 0.1))
        draw_in_order(canvas, cube, [], share)
        drawn[share] = canvas
    assert (drawn[0.0].mask == drawn[1.0].mask).all()
    outside = drawn[1.0].mask == 0
    assert (drawn[0.0].image[outside] != drawn[1.0].image[outside]).any(-1).mean() > 0.01
