"""Captures that bring cameras and points: both are started from, and nothing is sought."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mattgs_ops import sfm
from mattgs_ops.capture import sparse
from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.scene import POINTS_FILE, GivenPoints, PreparedCapture
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.given_points import given_model

Copy = Callable[..., PreparedCapture]
TOP = 0.7  # of the box, which stands on the table


def cloud(*, tracks: bool) -> GivenPoints:
    """Points on the box's top, then as many on the table beside it, seen by all or by unknown."""
    rng = np.random.default_rng(2)
    top = np.column_stack([rng.uniform(-0.3, 0.3, (150, 2)), np.full(150, TOP)])
    # toward the cameras: nowhere behind the box
    table = np.column_stack(
        [rng.uniform(1.0, 1.3, 150), rng.uniform(-0.2, 0.2, 150), np.zeros(150)]
    )
    xyz = np.concatenate([top, table])
    rgb = np.full(xyz.shape, 99, dtype=np.uint8)
    names = tuple(f"{k:04d}.jpg" for k in range(9))
    pairs = np.array([(i, j) for i in range(9) for j in range(300)])
    return GivenPoints(xyz, rgb, names, pairs if tracks else pairs[:0])


@pytest.mark.parametrize("tracks", [True, False])
def test_given_points_are_the_scenes(copied: Copy, tmp_path: Path, tracks: bool) -> None:
    capture = copied(cameras_are="given")
    given = cloud(tracks=tracks)
    given.save(capture.folder / POINTS_FILE)
    masks = capture.folder / "masks"
    scene = sfm.reconstruct(capture, masks, SfmConfig(), tmp_path / "out")
    extra = scene.extra
    assert (extra["mode"], extra["poses"], extra["points_source"]) == ("given", "given", "given")
    assert (extra["registered"], extra["points"], extra["seconds"]) == (9, 300, {})
    points = scene.points()
    np.testing.assert_array_equal(points.xyz, given.xyz)
    np.testing.assert_array_equal(points.object_share >= 0.8, np.arange(300) < 150)
    assert (tmp_path / "out" / "sfm.png").is_file()
    # what is written says the same again: later stages vote anew from it
    model = read_model(tmp_path / "out" / "sparse" / "0")
    again = sfm.assemble.vote(scene.views, model)
    np.testing.assert_array_equal(again.object_share, points.object_share)


def test_points_of_our_own_are_found_where_that_is_asked_for(copied: Copy) -> None:
    capture = copied(cameras_are="given")
    cloud(tracks=True).save(capture.folder / POINTS_FILE)
    assert given_model(capture, SfmConfig()) is not None
    assert given_model(capture, SfmConfig(points="triangulate")) is None
    assert given_model(capture, SfmConfig(poses="estimate")) is None
    assert given_model(replace(capture, cameras_are="truth"), SfmConfig()) is None


def test_a_handful_of_points_is_nothing_to_start_from(copied: Copy) -> None:
    capture = copied(cameras_are="given")
    few = cloud(tracks=False)
    few = GivenPoints(few.xyz[:99], few.rgb[:99], (), few.seen)
    few.save(capture.folder / POINTS_FILE)
    assert given_model(capture, SfmConfig()) is None


def test_views_without_a_camera_stay_without_one(copied: Copy, tmp_path: Path) -> None:
    capture = copied(cameras_are="given")
    capture = replace(capture, views=(replace(capture.views[0], camera=None), *capture.views[1:]))
    cloud(tracks=True).save(capture.folder / POINTS_FILE)
    scene = sfm.reconstruct(capture, capture.folder / "masks", SfmConfig(), tmp_path / "out")
    assert [m["name"] for m in scene.extra["missing"]] == ["0000.jpg"]
    assert len(sparse.on_object(scene.points()).xyz) == 150
