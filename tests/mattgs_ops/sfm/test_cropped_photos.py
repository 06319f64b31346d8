"""Specification of what becomes of a cropped photo: its camera is right, and the user is told."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from mattgs_ops import sfm
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap.job import Answer
from mattgs_ops.sfm.pipeline import warnings

Copy = Callable[..., PreparedCapture]


def cropped(view: View, masks: Path, left: int) -> View:
    """Cut columns on the left of a view's photo and mask away."""
    for path in (view.photo, masks / view.photo.name):
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        cv2.imwrite(str(path), picture[:, left:])
    return replace(view, width=view.width - left)


@pytest.mark.parametrize("left", [60, 130], ids=["axis in the photo", "axis beside it"])
def test_the_camera_of_a_cropped_photo_is_right(copied: Copy, tmp_path: Path, left: int) -> None:
    capture = copied()
    masks = capture.folder / "masks"
    views = list(capture.views)
    views[4] = cropped(views[4], masks, left)
    capture = replace(capture, views=tuple(views))
    scene = sfm.reconstruct(capture, masks, SfmConfig(), tmp_path / "out")
    extra = scene.extra
    assert extra["registered"] == 9
    assert extra["cropped"] == ["0004.jpg"]
    assert "1 are cropped, by where the axis of their lens is: 0004.jpg" in extra["fallbacks"]
    assert extra["warnings"] == []
    camera = scene.views[4].camera
    assert camera is not None
    assert camera.intrinsics.cx == pytest.approx(240 / 2 - left, abs=3)
    assert extra["pose_error"]["position_max"] < 0.02  # 0.04 with the axis in the middle


def test_photos_of_their_own_size_are_told_unless_their_axis_was_found(copied: Copy) -> None:
    capture = copied(cameras_are="none")
    views = list(capture.views)
    views[4], views[5] = (replace(views[n], taken=(900, 600 + n)) for n in (4, 5))
    capture = replace(capture, views=tuple(views))
    answer = Answer("shared", seconds={"map": 1.0}, registered=[view.name for view in views])
    (told,) = warnings(capture, answer)
    assert told.startswith("2 have a size that no other photo has: 0004.jpg, 0005.jpg; if they")
    answer.cropped = ["0005.jpg"]
    (told,) = warnings(capture, answer)
    assert told.startswith("1 have a size that no other photo has: 0004.jpg; if they")
