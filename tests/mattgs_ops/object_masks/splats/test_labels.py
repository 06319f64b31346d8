"""Labels of splats by the views' maps, and how they look to a camera."""

import numpy as np

from mattgs_ops.object_masks.splats.labels import render_labels
from tests.mattgs_ops.object_masks.ball import CENTRE, HEIGHT, VIEWS, WIDTH, orbit, truth
from tests.mattgs_ops.object_masks.splats.test_votes import (
    BALL,
    agreed,
    iou,
    labelled,
    scene_of_splats,
)


def test_a_splats_label_is_the_mean_of_what_its_pixels_were_given() -> None:
    cameras = orbit()
    maps = [np.full((HEIGHT, WIDTH), value, np.float32) for value in np.linspace(0.2, 0.8, VIEWS)]
    labels, weights = labelled(scene_of_splats(), cameras, maps)
    assert (weights[:BALL].sum(), (weights > 0).mean()) > (0, 0.9)
    assert labels.min() >= 0
    assert labels[weights > 1].min() >= 0.2 - 1e-5
    assert labels.max() <= 0.8 + 1e-5


def test_a_floater_before_a_camera_hides_nothing_from_it() -> None:
    cameras = orbit()
    near = CENTRE + 0.7 * (cameras[4].centre - CENTRE)
    shown, _ = agreed(scene_of_splats(near), cameras)
    assert iou(shown[4], truth(cameras[4])) > 0.8


def test_several_labels_are_rendered_at_once_as_they_are_one_by_one() -> None:
    cameras, splats = orbit(), scene_of_splats()
    place = agreed(splats, cameras)[1]
    chance = np.random.default_rng(3)
    labels = [chance.random(len(splats)).astype(np.float32) for _ in range(3)]
    together = render_labels(splats, labels, cameras[2], place)
    for label, shown in zip(labels, together, strict=True):
        alone = render_labels(splats, [label], cameras[2], place)[0]
        np.testing.assert_array_equal(shown, alone)
        assert shown.max() > 0.5
