"""An object that is itself the plane on which most points lie is not cut away as ground."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mattgs_ops.capture.masks import read_map
from mattgs_ops.object_masks import cross_view
from mattgs_ops.object_masks.cross_view import agree
from mattgs_ops.object_masks.decision import decide
from mattgs_ops.object_masks.map_scores import ViewMaps
from mattgs_ops.object_masks.silhouettes import iou, predict
from mattgs_ops.object_masks.splats.ground_plane import Plane
from tests.mattgs_ops.object_masks.ball import CENTRE, VIEWS
from tests.mattgs_ops.object_masks.splats.test_votes import BALL, made_of, scene_of_splats
from tests.mattgs_ops.object_masks.test_cross_view import painted, solved
from tests.mattgs_ops.object_masks.test_decision import (
    CAMERAS,
    NAMES,
    PLACE,
    TRUTHS,
    photos,
    votes,
)


def test_a_cut_that_leaves_little_of_what_the_maps_show_went_through_the_object() -> None:
    """Others' votes before the cut meet the maps well, and edges are everywhere."""
    left = []
    for camera in CAMERAS:
        soft = np.zeros_like(TRUTHS[0])
        column, row = camera.project(CENTRE[None])[0][0].astype(int)
        soft[row - 4 : row + 4, column - 4 : column + 4] = 1
        left.append(soft)
    place = replace(PLACE, ground=Plane(np.array([0.0, 0.0, 1.0]), 0.0, 0.6))
    cut = replace(votes(TRUTHS, left), agreement=[1.0] * VIEWS, place=place)
    edges = [np.ones_like(soft, dtype=bool) for soft in TRUTHS]
    outlines = predict(CAMERAS, TRUTHS)
    assert outlines is not None
    views = replace(ViewMaps.of(NAMES, photos(), TRUTHS, outlines, CAMERAS), edges=edges)
    found, maps = decide(views, cut)
    assert found.masks == "maps"
    assert found.left == pytest.approx(0.07, abs=0.01)
    assert "the ground's cut leaves 0.07" in found.reason
    assert iou(maps[0] >= 0.5, TRUTHS[0] >= 0.5) > 0.9


def test_a_painted_disc_with_a_knob_stays_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A painted disc in the plane that most points lie on, and a knob on it: both are the object.

    What the cut leaves, the knob, lies on edges of the photos, and is not what the maps show.
    """
    means = scene_of_splats().means.numpy()
    knob = np.arange(len(means)) < BALL
    means[knob] = (means[knob] - [0, 0, 0.6]) / 4 + [0, 0, 0.15]
    disc = ~knob & (np.linalg.norm(means[:, :2], axis=1) < 0.9)
    splats = made_of(means, np.where(knob, 0.01, 0.025))
    colours = np.random.default_rng(0).uniform(0.0, 0.9, (len(means), 3))
    colours[disc], colours[knob] = [0.1, 0.2, 0.7], [0.8, 0.1, 0.1]
    photos = [
        np.rint(photo.clip(0, 1) * 255).astype(np.uint8) for photo in painted(colours, splats)
    ]
    thing = (knob | disc)[:, None].repeat(3, 1)
    maps = [shown[..., 0].clip(0, 1) for shown in painted(thing, splats)]
    scene, capture = solved(tmp_path / "in", "u2net", maps, photos)
    monkeypatch.setattr(cross_view, "train_surfaces", lambda *_args, **_settings: splats)
    found = agree(scene, capture, tmp_path / "out")
    assert found.extra["agreement"]["ground_share"] > 0.5
    assert not found.extra["agreement"]["ground_cut"]
    scores = [
        iou(read_map(view.mask) > 0, shown >= 0.5)
        for view, shown in zip(found.views, maps, strict=True)
        if view.mask is not None
    ]
    assert np.mean(scores) > 0.85, scores
