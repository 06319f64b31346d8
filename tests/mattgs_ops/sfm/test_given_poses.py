"""Given cameras that contradict the photos are told of, and right ones are not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from mattgs_ops import sfm
from mattgs_ops.capture.scene import PreparedCapture, Scene
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap.job import Answer
from mattgs_ops.sfm.given_poses import FEWEST_PAIRS, Told, in_doubt, warnings

Copy = Callable[..., PreparedCapture]
NAMES = [f"{letter}.jpg" for letter in "abcdef"]


def solved(capture: PreparedCapture, out: Path) -> Scene:
    return sfm.reconstruct(capture, capture.folder / "masks", SfmConfig(), out)


def with_cameras_of(capture: PreparedCapture, others: list[int]) -> PreparedCapture:
    """Give each view the camera of another."""
    given = [capture.views[k].camera for k in others]
    views = tuple(replace(v, camera=c) for v, c in zip(capture.views, given, strict=True))
    return replace(capture, views=views)


def test_right_cameras_are_not_doubted(copied: Copy, tmp_path: Path) -> None:
    extra = solved(copied(cameras_are="given"), tmp_path / "out").extra
    told = extra["given_cameras"]
    assert told["pairs"] >= FEWEST_PAIRS
    assert (told["explained"], told["contradicted"]) == (told["pairs"], [])
    assert (extra["warnings"], extra["poses_in_doubt"]) == ([], False)
    assert extra["object_motion"] == {"contradicting": None, "shared": None}  # no pair was tested


def test_cameras_of_other_photos_are_in_doubt(copied: Copy, tmp_path: Path) -> None:
    wrong = with_cameras_of(copied(cameras_are="given"), [3, 7, 1, 8, 0, 2, 5, 4, 6])
    extra = solved(wrong, tmp_path / "out").extra
    assert extra["poses_in_doubt"]
    assert extra["warnings"][0].startswith("given cameras contradict the photos: they explain only")


def test_one_camera_that_is_wrong_is_named(copied: Copy, tmp_path: Path) -> None:
    capture = copied(cameras_are="given")
    trained = [k for k, view in enumerate(capture.views) if view.split == "train"]
    places = list(range(len(capture.views)))
    places[trained[2]] = trained[-1]
    extra = solved(with_cameras_of(capture, places), tmp_path / "out").extra
    name = capture.views[trained[2]].name
    assert extra["given_cameras"]["contradicted"] == [name]
    assert [name in text for text in extra["warnings"]] == [True]
    assert not extra["poses_in_doubt"]


@pytest.mark.parametrize(
    ("pairs", "wrong"),
    [
        ({(0, 1): True, (1, 2): True}, []),
        ({(0, 1): True, (1, 2): False}, [2]),
        ({(0, 3): False, (3, 4): False, (4, 5): True}, [3]),  # 0 has no pair but with 3
        ({(0, 1): False, (2, 3): True}, [0, 1]),  # either may be
        ({(0, 1): False, (1, 2): False, (0, 2): False}, [0, 1, 2]),
        ({}, []),
    ],
)
def test_a_pair_is_laid_to_one_view_where_it_can_be(
    pairs: dict[tuple[int, int], bool], wrong: list[int]
) -> None:
    assert Told(pairs).contradicted() == wrong


def test_too_few_pairs_say_nothing() -> None:
    few = Told({(0, 1): False, (1, 2): False}).to_json(NAMES)
    assert few == {"pairs": 2, "explained": 0, "contradicted": []}
    answer = Answer("shared", given_cameras=few)
    assert (in_doubt(answer), warnings(answer)) == (False, [])
    assert (in_doubt(Answer("shared")), warnings(Answer("shared"))) == (False, [])


def test_more_than_half_of_the_pairs_must_be_unexplained() -> None:
    half = Told({(0, 1): False, (2, 3): False, (0, 2): True, (1, 3): True}).to_json(NAMES)
    assert not in_doubt(Answer("shared", given_cameras=half))
    most = Told({(0, 1): False, (2, 3): False, (0, 2): True}).to_json(NAMES)
    answer = Answer("shared", given_cameras=most)
    assert in_doubt(answer)
    assert "only 1 of 3 pairs of photos that match" in warnings(answer)[0]
