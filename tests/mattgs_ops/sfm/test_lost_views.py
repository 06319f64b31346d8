"""Views without a camera: the reason of each, and second groups, in words and as data."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops import sfm
from mattgs_ops.capture.scene import FROM_OBJECT, PreparedCapture, View
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import StageError
from mattgs_ops.sfm import pipeline
from mattgs_ops.sfm.colmap.job import Answer
from mattgs_ops.sfm.colmap.matching import partners
from mattgs_ops.sfm.colmap.moving_object import STANDS_STILL
from mattgs_ops.sfm.lost_views import (
    OBJECT_TURNS,
    in_doubt,
    lost_views,
    second_groups,
    warnings,
)
from mattgs_ops.sfm.pipeline import _require_registered
from tests.mattgs_ops.conftest import HEIGHT, WIDTH, cast, orbit, print_texture

NAMES = [f"{letter}.jpg" for letter in "abcdefgh"]


def capture_of(names: list[str]) -> PreparedCapture:
    views = tuple(
        View(name, "test" if i % 4 == 0 else "train", 8, 6, Path(name), None, None)
        for i, name in enumerate(names)
    )
    return PreparedCapture("thing", Path(), views, "none", "none")


def answer_of(**changes: object) -> Answer:
    """Four of eight views placed; the reasons of the others all differ."""
    answer = Answer(
        "shared",
        keypoints=dict.fromkeys(NAMES, (900, 90)) | {"e.jpg": (41, 3)},
        registered=NAMES[:4],
        components=[NAMES[:4], ["d.jpg", "g.jpg", "h.jpg"]],
        partners=partners({(0, 1): 300, (1, 5): 16, (0, 5): 18, (6, 7): 80}, NAMES),
    )
    return replace(answer, **changes)  # type: ignore[arg-type]


def test_partners_are_sorted_best_first() -> None:
    found = partners({(0, 1): 20, (0, 2): 30, (1, 2): 20}, ["a", "b", "c"])
    assert found == {
        "a": [("c", 30), ("b", 20)],
        "b": [("a", 20), ("c", 20)],
        "c": [("a", 30), ("b", 20)],
    }


def test_each_lost_view_has_its_own_reason() -> None:
    found = {view.name: view.reason for view in lost_views(capture_of(NAMES), answer_of())}
    assert list(found) == NAMES[4:]
    assert found["e.jpg"].startswith("shows only 41 key points")
    assert found["f.jpg"].startswith("matches a.jpg (18 points) and b.jpg (16 points), too few")
    assert found["g.jpg"] == "matches only photos of a second group, h.jpg (80 points)"
    alone = lost_views(capture_of(NAMES), answer_of(partners={}))
    assert alone[1].reason.startswith("is matched by no other photo")
    apart = lost_views(capture_of(NAMES), answer_of(components=[NAMES[:4]]))
    assert apart[2].reason.startswith("matches only photos that were not placed either")
    given = lost_views(capture_of(NAMES), answer_of(keypoints={}))
    assert given[0].reason == "came without a camera"


def test_a_second_group_is_told_and_how_to_join_it() -> None:
    assert second_groups(answer_of()) == [["g.jpg", "h.jpg"]]
    first, second = warnings(capture_of(NAMES), answer_of())
    assert first.startswith("only 4 of 8 views have a camera; nothing is trained or scored at")
    assert "1 of them held out: " in first
    assert "e.jpg shows only 41 key points" in first
    assert second.startswith("2 views form a second group that nothing ties to the first: g.jpg")
    assert "take photos between the two" in second


def test_views_that_are_lost_for_one_reason_are_told_together() -> None:
    first = warnings(capture_of(NAMES), answer_of(components=[NAMES[:4]]))[0]
    assert "; g.jpg, h.jpg match only photos that were not placed either" in first
    unmatched = warnings(capture_of(NAMES), answer_of(partners={}))[0]
    assert "f.jpg, g.jpg, h.jpg are matched by no other photo" in unmatched
    given = warnings(capture_of(NAMES), answer_of(keypoints={}))[0]
    assert given.endswith(": e.jpg, f.jpg, g.jpg, h.jpg came without a camera")


def test_held_out_views_are_counted_where_some_are_lost() -> None:
    capture = capture_of(NAMES)
    trained = replace(capture, views=tuple(replace(v, split="train") for v in capture.views))
    assert "scored at the others: " in warnings(trained, answer_of())[0]


def test_lost_views_of_an_object_on_a_turntable_come_with_what_to_do() -> None:
    turned = answer_of(fallbacks=[f"{STANDS_STILL}: {FROM_OBJECT}"])
    assert warnings(capture_of(NAMES), turned)[-1] == OBJECT_TURNS
    assert OBJECT_TURNS not in warnings(capture_of(NAMES), answer_of())
    assert warnings(capture_of(NAMES), replace(turned, registered=NAMES)) == []


def test_a_photo_of_a_size_of_its_own_is_told_unless_its_camera_came_along() -> None:
    views = [replace(v, width=7) if v.name == "d.jpg" else v for v in capture_of(NAMES).views]
    capture = replace(capture_of(NAMES), views=tuple(views))
    for seconds, told in (({"map": 1.0}, 1), ({}, 0)):
        said = pipeline.warnings(capture, answer_of(registered=NAMES, seconds=seconds))
        assert len(said) == told
        assert all("d.jpg; if they are cropped" in one for one in said)


def test_nothing_is_said_where_all_views_were_placed() -> None:
    assert warnings(capture_of(NAMES), answer_of(registered=NAMES)) == []
    assert not in_doubt(capture_of(NAMES), answer_of(registered=NAMES))
    assert in_doubt(capture_of(NAMES), answer_of(registered=NAMES[1:]))


def test_too_few_views_fail_with_the_reasons() -> None:
    _require_registered(capture_of(NAMES), answer_of(), 0.5)
    with pytest.raises(StageError, match="2 views form a second group") as error:
        _require_registered(capture_of(NAMES), answer_of(), 0.6)
    assert str(error.value).startswith("structure-from-motion placed 4 of 8 views (50%)")
    assert "e.jpg shows only 41 key points" in str(error.value)
    with pytest.raises(StageError, match="EXIF") as error:
        _require_registered(capture_of(NAMES), answer_of(), 0.6, ["remove EXIF"])
    assert str(error.value).endswith("\nremove EXIF")


@pytest.fixture
def two_scenes(copied: Callable[..., PreparedCapture]) -> PreparedCapture:
    """Put three photos of another box into the folder of the first."""
    capture = copied(cameras_are="none")
    rng = np.random.default_rng(99)
    textures = [print_texture(rng, 1024, 8000), *(print_texture(rng, 256, 650) for _ in range(6))]
    views = list(capture.views)
    for k, camera in enumerate(orbit(3)):
        name = f"other_{k}.jpg"
        photo = capture.folder / "photos" / f"{name}.png"
        mask = capture.folder / "masks" / f"{name}.png"
        image, cut = cast(camera, textures)
        cv2.imwrite(str(photo), image)
        cv2.imwrite(str(mask), cut)
        views.append(View(name, "train", WIDTH, HEIGHT, photo, mask, None))
    return replace(capture, views=tuple(views))


def test_photos_of_two_scenes_are_two_groups(two_scenes: PreparedCapture, tmp_path: Path) -> None:
    masks = two_scenes.folder / "masks"
    scene = sfm.reconstruct(two_scenes, masks, SfmConfig(mode="original"), tmp_path / "out")
    extra = scene.extra
    assert extra["registered"] == 9
    assert extra["second_groups"] == [[f"other_{k}.jpg" for k in range(3)]]
    assert all("second group" in view["reason"] for view in extra["missing"])
    assert extra["warnings"][0].startswith("only 9 of 12 views have a camera")
    assert extra["poses_in_doubt"]
