"""Training images: objects central, complete, masked exactly."""

import numpy as np
import pytest

from mattgs_ops.segment.network.train_config import WorldConfig
from mattgs_ops.segment.training_images.composites import Composites
from mattgs_ops.segment.training_images.draw import Camera, Canvas, Light, near_clipped
from mattgs_ops.segment.training_images.solids import Face, Paint, box, frame, up
from mattgs_ops.segment.training_images.textures import SIZE, Bank
from mattgs_ops.segment.training_images.things import OBJECTS, Recipe
from mattgs_ops.segment.training_images.traced.backdrops import Backdrop


def canvas(bank: Bank, side: int = 64) -> Canvas:
    camera = Camera.facing(np.array([0, -4.0, 0]), np.zeros(3), side, 1.0, 1.0, 0.0)
    light = Light(np.array([0, 0, 1.0]), 1.0, 0.0, 0.0, 1.0)
    return Canvas(side, camera, light, bank, np.random.default_rng(0))


def test_samples_follow_from_seed_and_index(bank: Bank) -> None:
    first, again = Composites(3, 48, bank), Composites(3, 48, bank)
    for index in (0, 7):
        for a, b in zip(first.sample(index), again.sample(index), strict=True):
            assert np.array_equal(a, b)
    assert not np.array_equal(first.sample(0)[0], first.sample(1)[0])
    assert not np.array_equal(first.sample(0)[0], Composites(4, 48, bank).sample(0)[0])


def test_objects_are_central_complete_and_of_sensible_size(bank: Bank) -> None:
    source = Composites(1, 48, bank)
    shares, offsets, touching = [], [], 0
    for index in range(24):
        image, mask = source.sample(index)
        assert image.shape == (48, 48, 3)
        assert image.dtype == mask.dtype == np.uint8
        found = np.argwhere(mask > 127)
        shares.append(len(found) / mask.size)
        offsets.append(np.abs(found.mean(0) / 48 - 0.5).max())
        edge = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
        touching += bool((edge > 127).sum() > 2)
    assert min(shares) > 0.005
    assert max(shares) < 0.7
    assert np.median(offsets) < 0.12
    assert 0 < touching <= 4  # a few reach over the frame's edge


def test_shares_say_which_worlds_are_painted(bank: Bank) -> None:
    plain = Composites(1, 32, bank, world=WorldConfig(plain=1.0, walls=0.0, figures=1.0))
    desks = Composites(1, 32, bank, world=WorldConfig(plain=0.0, walls=0.0, figures=0.0))

    def unrest(source: Composites) -> float:
        """Return the median, over samples, of the ground's differences from pixel to pixel."""
        steps = []
        for index in range(6):
            image, mask = source.sample(index)
            rough = np.abs(np.diff(image.astype(float), axis=1)).mean(2)
            steps.append(rough[mask[:, 1:] == 0].mean())
        return float(np.median(steps))

    assert unrest(plain) < 0.5 * unrest(desks)


@pytest.mark.parametrize("recipe", dict.fromkeys(OBJECTS))
def test_recipes_stand_on_the_ground_around_the_origin(recipe: Recipe) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        faces = recipe(rng, Paint.random(rng))
        points = np.concatenate([c for face in faces for c in face.contours])
        assert np.isfinite(points).all()
        assert -0.15 < points[:, 2].min() < 0.1
        assert np.abs(points[:, :2]).max() < 1.8
        for face in faces:
            assert np.isclose(np.linalg.norm(face.normal), 1) or not face.normal.any()


def test_a_box_covers_what_its_projection_says(bank: Bank) -> None:
    shown = canvas(bank)
    shown.draw(box(np.zeros(3), np.ones(3), (1, 0, 0)), is_object=True)
    # the front face, 3.5 away at a focal length of 64 pixels, is 64 / 3.5 wide
    assert (shown.mask > 0).sum() == pytest.approx((64 / 3.5) ** 2, rel=0.12)
    assert shown.image[32, 32].tolist() == [255, 0, 0]
    assert shown.image[2, 2].tolist() == [0, 0, 0]


def test_holes_show_the_background_and_nearer_clutter_hides_the_object(bank: Bank) -> None:
    turn = frame(np.array([0, -1.0, 0]))
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) @ turn.T
    plate = Face([square, square * 0.4], np.zeros(3), (0, 1, 0))
    shown = canvas(bank)
    shown.draw([plate], is_object=True)
    assert shown.mask[32, 32] == 0
    assert shown.mask[32, 20] == 255
    shown.draw(box(np.array([-0.7, -1, 0]), np.full(3, 0.4), (0, 0, 1)), is_object=False)
    assert shown.mask[32, 20] == 0


def test_clipping_at_the_near_plane_keeps_what_is_in_front(bank: Bank) -> None:
    camera = canvas(bank).camera
    behind = np.array([[-1, -9, 0], [1, -9, 0], [1, 0, 0], [-1, 0, 0.0]])
    kept = near_clipped(behind, camera)
    assert len(kept) == 4
    assert kept[:, 1].min() > -4
    assert len(near_clipped(behind - [0, 20, 0], camera)) == 0


def test_patterns_use_the_whole_range(bank: Bank) -> None:
    for patterns in bank.patterns.values():
        for pattern in patterns:
            assert pattern.shape == (SIZE, SIZE)
            assert pattern.dtype == np.uint8
    spread = [int(np.ptp(p)) for ps in bank.patterns.values() for p in ps]
    assert np.mean(spread) > 100


def test_objects_are_painted_where_a_backdrops_camera_sees_the_origin(bank: Bank) -> None:
    pose = np.eye(4)  # OpenGL: looks along -z; here from above, the photo's upper edge towards y
    pose[:3, 3] = [0, 0, 60]
    backdrop = Backdrop(np.full((60, 80, 3), 90, np.uint8), pose, top=0.5)
    pixels, depth = backdrop.camera(32, 10.0).project(np.stack([np.zeros(3), up(1.0)]))
    assert pixels[0] == pytest.approx([16, 16])
    assert depth == pytest.approx([5.95, 4.95])
    side, _ = backdrop.camera(32, 10.0).project(np.array([[1.0, 0, 0], [0, 1.0, 0]]))
    assert side[0][0] > 16  # x to the right
    assert side[1][1] < 16  # y up
    image, mask = Composites(0, 32, bank, (backdrop,), 1.0).sample(0)
    assert image.shape == (32, 32, 3)
    assert 0 < (mask > 127).mean() < 0.7
