"""Where an object is among splats, whatever maps take along from behind it."""

import math

import numpy as np
import pytest

from mattgs_ops.object_masks.splats.attached_parts import FAR
from mattgs_ops.object_masks.splats.labels import Place, render_labels
from mattgs_ops.object_masks.splats.location import distances_from, locate, within_reach
from mattgs_ops.object_masks.splats.votes import collect, masks_of
from tests.mattgs_ops.object_masks.ball import CENTRE, HEIGHT, RADIUS, VIEWS, WIDTH, orbit, truth
from tests.mattgs_ops.object_masks.splats.test_votes import (
    BALL,
    iou,
    labelled,
    made_of,
    scene_of_splats,
)


@pytest.mark.parametrize("triangulated", [True, False])
def test_the_ground_is_sought_among_triangulated_points_first(triangulated: bool) -> None:
    """The desk's splats are thick, and lie a fifth of the ball's radius too high."""
    cameras, splats = orbit(), scene_of_splats()
    splats.means[BALL:, 2] += 0.2 * RADIUS
    rng = np.random.default_rng(2)
    on_desk = np.concatenate([rng.uniform(-2, 2, (400, 2)), np.zeros((400, 1))], axis=1)
    points = on_desk if triangulated else rng.normal(0, 1, (400, 3)) + CENTRE
    labels, weights = labelled(splats, cameras, [truth(camera) for camera in cameras])
    place = locate(splats, labels, weights, cameras, points)
    assert place is not None
    assert place.ground is not None
    assert place.ground.offset == pytest.approx(0 if triangulated else 0.2 * RADIUS, abs=0.02)


def test_maps_that_show_nothing_locate_nothing() -> None:
    cameras = orbit()
    maps = [np.zeros((HEIGHT, WIDTH), np.float32)] * VIEWS
    splats = scene_of_splats()
    assert locate(splats, *labelled(splats, cameras, maps), cameras) is None


def test_a_plate_that_is_object_is_no_ground() -> None:
    cameras, splats = orbit(), scene_of_splats()
    maps = [truth(camera) for camera in cameras]
    labels, weights = labelled(splats, cameras, maps)
    plate = np.linalg.norm(splats.means.numpy() - [0, 0, 0], axis=1) < 0.75 * RADIUS
    beyond = np.abs(splats.means.numpy()[:, 2]) < 0.01
    weights = np.where(beyond & ~plate, 0, weights)  # nothing is seen of the desk but the plate
    place = locate(splats, np.where(plate, 1, labels).astype(np.float32), weights, cameras)
    assert place is not None
    assert place.ground is None


def ball_of_splats(middle: np.ndarray, radius: float, count: int = 1000) -> np.ndarray:
    """Return points [N, 3] all around ``middle``, near enough to each other to touch."""
    ways = np.random.default_rng(5).normal(size=(count, 3))
    return middle + radius * ways / np.linalg.norm(ways, axis=1, keepdims=True)


def place_of(means: np.ndarray, weights: np.ndarray | None = None) -> Place:
    """Locate what all votes are certain about."""
    ones = np.ones(len(means), np.float32)
    seen = ones if weights is None else weights.astype(np.float32)
    place = locate(made_of(means, np.full(len(means), 0.04)), ones, seen, orbit())
    assert place is not None
    return place


def test_what_lies_far_behind_is_another_thing() -> None:
    """A cushion that maps of a few photos take along does not make the object larger."""
    cushion = CENTRE + np.array([0, 8 * RADIUS, 0])
    means = np.concatenate([ball_of_splats(CENTRE, RADIUS), ball_of_splats(cushion, RADIUS, 400)])
    place = place_of(means)
    assert place.radius == pytest.approx(RADIUS, rel=0.1)
    np.testing.assert_allclose(place.middle, CENTRE, atol=0.1)
    near = within_reach(made_of(means, np.ones(1400)), place)
    assert (near == ([True] * 1000 + [False] * 400)).all()


def test_the_object_is_what_views_see_most_of() -> None:
    """A wall behind it may have more splats, each of which few photos show."""
    wall = CENTRE + np.array([0, 20 * RADIUS, 0])
    means = np.concatenate([ball_of_splats(CENTRE, RADIUS), ball_of_splats(wall, RADIUS, 3000)])
    weights = np.repeat([30.0, 3.0], [1000, 3000])
    np.testing.assert_allclose(place_of(means, weights).middle, CENTRE, atol=0.1)


def test_pieces_near_the_object_belong_to_it() -> None:
    """Wheels whose axles votes are not certain about, and a train of pieces, each near the next."""
    near = [CENTRE + np.array([step * RADIUS, 0, 0]) for step in (0, 2, 4, 6)]
    means = np.concatenate([ball_of_splats(one, 0.6 * RADIUS) for one in near])
    place = place_of(means)
    assert place.reach == math.inf
    lengths = np.linalg.norm(means - np.median(means, axis=0), axis=1)
    assert place.radius == pytest.approx(float(np.quantile(lengths, 0.9)))


def test_no_mask_holds_what_lies_far_behind() -> None:
    """Nine of ten maps take a ball along that hangs behind the one on the desk."""
    cameras, splats = orbit(), scene_of_splats()
    behind = ball_of_splats(np.array([0.0, 5 * RADIUS, 3 * RADIUS]), 0.5 * RADIUS)
    means = np.concatenate([splats.means.numpy(), behind])
    splats = made_of(means, np.full(len(means), 0.02))
    both = np.ones(len(means), np.float32)
    both[BALL : len(means) - len(behind)] = 0
    everywhere = Place(CENTRE, RADIUS, None)
    maps = [render_labels(splats, [both], camera, everywhere)[0] for camera in cameras]
    maps[0] = truth(cameras[0])
    splat_votes = collect(splats, cameras, maps)
    assert splat_votes is not None
    assert splat_votes.place.reach == FAR * splat_votes.place.radius
    assert (distances_from(splats, splat_votes.place)[-len(behind) :] > FAR).all()
    votes = masks_of(splat_votes, cameras)
    truths = [truth(camera) for camera in cameras]
    extra = [int((m > 0.5).sum() - t.sum()) for m, t in zip(maps, truths, strict=True)]
    assert max(extra) > 50, "some view shows the ball behind"
    for made in (votes.predicted, votes.certain, votes.with_parts):
        assert min(iou(one, t) for one, t in zip(made, truths, strict=True)) > 0.75
