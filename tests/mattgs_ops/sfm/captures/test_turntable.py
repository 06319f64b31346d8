"""A camera on a tripod before a turntable: what does not turn with the object gives no poses."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops import sfm
from mattgs_ops.capture.masks import read_map
from mattgs_ops.capture.photos import read_rgb
from mattgs_ops.capture.scene import PreparedCapture, Scene
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import StageError
from mattgs_ops.sfm.lost_views import OBJECT_TURNS
from tests.mattgs_ops.conftest import print_texture

Copy = Callable[..., PreparedCapture]


def test_poses_come_from_the_object_where_all_else_stands_still(
    copied: Copy, tmp_path: Path
) -> None:
    capture = copied()
    room = print_texture(np.random.default_rng(5), 256, 900)
    for view in capture.views:
        assert view.mask is not None
        photo = read_rgb(view.photo)
        around = read_map(view.mask) == 0
        photo[around] = room[: view.height, : view.width][around].astype(np.uint8)
        cv2.imwrite(str(view.photo), photo)
    masks = capture.views[0].mask
    assert masks is not None
    scene = sfm.reconstruct(capture, masks.parent, SfmConfig(), tmp_path / "out")
    assert scene.extra["mode"] == "masked"
    assert "most matches do not move: poses from inside masks alone" in scene.extra["fallbacks"]
    assert scene.extra["registered"] >= 8


def test_poses_come_from_the_object_where_it_moves_against_the_room(
    copied: Copy, tmp_path: Path
) -> None:
    """A turntable before a camera in a hand: the room moves too, but otherwise."""
    capture = copied()
    room = print_texture(np.random.default_rng(5), 400, 900)
    for number, view in enumerate(capture.views):
        assert view.mask is not None
        photo = read_rgb(view.photo)
        around = read_map(view.mask) == 0
        left, top = 4 * number, 3 * (number % 5)
        shown = room[top : top + view.height, left : left + view.width]
        photo[around] = shown[around].astype(np.uint8)
        cv2.imwrite(str(view.photo), photo)
    masks = capture.views[0].mask
    assert masks is not None
    scene = sfm.reconstruct(capture, masks.parent, SfmConfig(), tmp_path / "out")
    motion = scene.extra["object_motion"]
    assert motion["masked"] > 0.9 > motion.get("shared", 0.0)
    assert scene.extra["mode"] == "masked"
    reason = "the object moves against its surroundings: poses from inside masks alone"
    assert scene.extra["fallbacks"][0] == reason
    assert scene.extra["registered"] >= 8


def test_a_camera_that_walks_keeps_the_whole_photo(box_scene: Scene) -> None:
    assert box_scene.extra["mode"] == "shared"
    assert not box_scene.extra["fallbacks"]
    assert box_scene.extra["object_motion"]["contradicting"] < 0.1


def test_a_plain_object_on_a_turntable_fails_with_what_to_do(copied: Copy, tmp_path: Path) -> None:
    capture = copied()
    room = print_texture(np.random.default_rng(5), 256, 900)
    for view in capture.views:
        assert view.mask is not None
        photo = room[: view.height, : view.width].astype(np.uint8)
        photo[read_map(view.mask) > 0] = 200
        cv2.imwrite(str(view.photo), photo)
    masks = capture.views[0].mask
    assert masks is not None
    notes: list[str] = []
    with pytest.raises(StageError, match="at every 10 degrees or less") as failure:
        sfm.reconstruct(
            capture,
            masks.parent,
            SfmConfig(),
            tmp_path / "out",
            progress=lambda _, __, note: notes.append(note),
        )
    assert str(failure.value).count(OBJECT_TURNS) == 1
    begun = [next(n for n in notes if n.startswith(start)) for start in ("extract", "attempt 2, ")]
    assert notes.index(begun[0]) < notes.index(begun[1])  # the bar begins anew, and says why
