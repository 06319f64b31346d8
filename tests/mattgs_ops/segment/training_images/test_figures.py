"""Smooth figures: rays hit where geometry says, masks and shadows follow."""

from collections.abc import Callable

import numpy as np
import pytest

from mattgs_ops.segment.training_images.draw import Camera, Canvas, Light
from mattgs_ops.segment.training_images.figure_families import (
    FAMILIES,
    ball,
    block,
    drum,
    random_figure,
)
from mattgs_ops.segment.training_images.figures import (
    FAR,
    Figure,
    Shape,
    cast,
    draw_figure,
    figure_shadow,
)
from mattgs_ops.segment.training_images.solids import Paint, up
from mattgs_ops.segment.training_images.textures import Bank

SIDE = 64
RED = (0.9, 0.1, 0.1)


def camera() -> Camera:
    """Look along +y at the origin from four units away; a unit is 16 pixels there."""
    return Camera.facing(np.array([0, -4.0, 0]), np.zeros(3), SIDE, 1.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("shape", "depth"),
    [
        (ball(np.zeros(3), np.array([1.0, 0.5, 1.0]), RED), 3.5),
        (block(np.zeros(3), [1.0, 2.0, 1.0], RED), 3.0),
        (drum(up(-1.0), 2.0, 0.75, RED), 3.25),
    ],
    ids=["ball", "block", "drum"],
)
def test_a_ray_through_the_middle_hits_the_near_side(shape, depth) -> None:  # type: ignore[no-untyped-def]
    depths, which, normals = cast([shape], camera())
    middle = (SIDE // 2, SIDE // 2)
    assert depths[middle] == pytest.approx(depth, abs=0.01)
    assert which[middle] == 0
    assert normals[middle] @ [0, -1, 0] > 0.99
    assert depths[0, 0] == FAR


def test_a_cylinder_is_closed_at_its_top() -> None:
    above = Camera.facing(np.array([0, -0.1, 4.0]), np.zeros(3), SIDE, 1.0, 1.0, 0.0)
    depths, _, normals = cast([drum(np.zeros(3), 1.0, 0.5, RED)], above)
    assert depths[SIDE // 2, SIDE // 2] == pytest.approx(3.0, abs=0.02)
    assert normals[SIDE // 2, SIDE // 2] == pytest.approx([0, 0, 1])


def test_the_nearer_shape_hides_the_farther_one() -> None:
    shapes = [ball(np.array([0, y, 0.0]), np.full(3, 0.3), RED) for y in (1, -1)]
    _, which, _ = cast(shapes, camera())
    assert which[SIDE // 2, SIDE // 2] == 1


def test_mask_is_the_projection_and_the_light_side_is_brighter(bank: Bank) -> None:
    light = Light(np.array([1.0, 0, 1.0]) / np.sqrt(2), 0.2, 0.0, 0.5, 1.0)
    canvas = Canvas(SIDE, camera(), light, bank, np.random.default_rng(0))
    figure = Figure([ball(np.zeros(3), np.ones(3), (0.8, 0.8, 0.8))], False, 0.0, 0.0)
    draw_figure(canvas, figure)
    # a ball of radius 1, four units away: its rim is seen at tan(asin(1 / 4))
    radius = SIDE * np.tan(np.arcsin(0.25))
    assert (canvas.mask > 0).sum() == pytest.approx(np.pi * radius**2, rel=0.05)
    assert canvas.image[32, 44].mean() > 2 * canvas.image[32, 20].mean()
    assert not canvas.image[canvas.mask == 0].any()


def test_a_figure_darkens_the_ground_away_from_the_light(bank: Bank) -> None:
    above = Camera.facing(np.array([0, -0.1, 6.0]), np.zeros(3), SIDE, 1.0, 1.0, 0.0)
    light = Light(np.array([1.0, 0, 1.0]) / np.sqrt(2), 0.5, 0.0, 0.8, 0.3)
    canvas = Canvas(SIDE, above, light, bank, np.random.default_rng(0))
    canvas.image[:] = 200
    figure_shadow(canvas, Figure([drum(np.zeros(3), 1.5, 0.3, RED)], False, 0.0, 0.0))
    pixel, _ = above.project(np.array([[-1.0, 0, 0], [1.0, 0, 0]]))
    (dark, lit) = (canvas.image[int(y), int(x), 0] for x, y in pixel)
    assert dark < 80
    assert lit == 200


@pytest.mark.parametrize("family", dict.fromkeys(FAMILIES))
def test_families_stand_on_the_ground_around_the_origin(
    family: Callable[[np.random.Generator, Paint], list[Shape]],
) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        shapes = family(rng, Paint.random(rng))
        points = Figure(shapes, False, 0.0, 0.0).points
        assert np.isfinite(points).all()
        assert -0.3 < points[:, 2].min() < 0.12
        assert np.abs(points[:, :2]).max() < 2.2


def test_figures_follow_from_the_seed_and_take_given_colours() -> None:
    first, again = (random_figure(np.random.default_rng(5), [RED]) for _ in range(2))
    assert np.array_equal(first.points, again.points)
    assert {shape.colour for shape in first.shapes} == {RED}
