"""Sides of a box that look alike: poses that they lead astray are found out by the table."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mattgs_ops import sfm
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import StageError
from mattgs_ops.progress import no_progress
from mattgs_ops.sfm import look_alikes
from mattgs_ops.sfm.colmap.features import Pair
from mattgs_ops.sfm.colmap.job import Answer, Job, JobView
from mattgs_ops.sfm.colmap.matching import Verified
from mattgs_ops.sfm.colmap.steps import Attempt
from tests.mattgs_ops import conftest as box

AROUND = 24  # photos, a full circle
NOTHING = np.zeros((0, 2), np.uint32)


def test_photos_of_one_side_are_not_placed_before_the_other(tmp_path: Path) -> None:
    """From all pairs half of the cameras come out half a turn away."""
    cameras = box.orbit(AROUND, 2 * np.pi / AROUND)
    capture = box.photographed_by(tmp_path / "in", box.with_equal_sides(7), cameras)
    scene = sfm.reconstruct(capture, tmp_path / "in" / "masks", SfmConfig(), tmp_path / "out")
    assert scene.extra["registered"] == AROUND
    assert scene.extra["pose_error"]["rotation_deg_max"] < 1
    (step,) = scene.extra["fallbacks"]
    assert step.endswith(look_alikes.LEFT_OUT)
    told = scene.extra["beside_object"]
    assert told["explained"] == told["pairs"] > AROUND
    assert not scene.extra["poses_in_doubt"]
    assert scene.extra["mode"] == "shared"


def pairs(beside: dict[Pair, int]) -> dict[Pair, Verified]:
    return {pair: Verified(None, NOTHING, None, count) for pair, count in beside.items()}


def test_a_view_that_shares_nothing_beside_the_object_keeps_its_pairs() -> None:
    found = pairs({(0, 1): 15, (1, 2): 40, (0, 3): 0, (2, 3): 0})
    assert look_alikes.sure_pairs(found) == {(0, 1), (1, 2)}
    assert set(look_alikes.without_look_alikes(found, 15)) == set(found)


def test_a_view_that_shares_little_keeps_what_shares_most() -> None:
    """View 9 has no sure pair; of its six, two share nothing and the others one to four."""
    sure = {(view, view + 1): 20 for view in range(6)}
    little = {(view, 9): count for view, count in enumerate((4, 0, 3, 1, 2, 0))}
    found = pairs(sure | little)
    assert look_alikes.sure_pairs(found) == set(sure)
    little_kept = {(0, 9), (2, 9), (3, 9), (4, 9)}
    assert set(look_alikes.without_look_alikes(found, 1)) == {*sure, *little_kept}
    assert set(look_alikes.without_look_alikes(found, 15)) == {*sure, *little}, "tied by nothing"


def test_pairs_that_match_on_the_object_alone_are_left_out() -> None:
    found = pairs({(view, view + 1): 20 for view in range(9)} | {(0, 9): 0, (1, 8): 0})
    assert set(look_alikes.without_look_alikes(found, 15)) == {(v, v + 1) for v in range(9)}


def test_sure_pairs_are_those_of_the_four_partners_that_share_most() -> None:
    """View 0 shares less with each further view, and these share nothing with each other."""
    found = pairs({(0, other): 60 - other for other in range(1, 8)})
    ring = pairs({(first, first + 1): 90 for first in range(10, 16)})
    assert look_alikes.sure_pairs(found) == set(found), "each is the best of its other view"
    many = found | pairs({(other, 8 + k): 80 for other in range(1, 8) for k in range(4)}) | ring
    assert {pair for pair in look_alikes.sure_pairs(many) if 0 in pair} == {
        (0, other) for other in range(1, 5)
    }


@pytest.mark.parametrize(
    ("pairs", "explained", "mode", "doubted"),
    [
        (60, 60, "shared", False),
        (60, 58, "shared", False),
        (60, 57, "shared", True),
        (6, 3, "shared", True),
        (60, 10, "masked", False),  # an object that moves against what stands beside it
    ],
)
def test_three_sure_pairs_that_are_unexplained_leave_poses_in_doubt(
    pairs: int, explained: int, mode: str, doubted: bool
) -> None:
    answer = replace(Answer(mode), beside_object={"pairs": pairs, "explained": explained})
    assert look_alikes.in_doubt(answer) is doubted
    told = look_alikes.warnings(answer)
    wanted = f"of {pairs} pairs of photos that share most beside the object {pairs - explained} "
    assert [text.startswith(wanted) for text in told] == [True] * doubted


class Model:
    """Stands for pycolmap's, of so many views."""

    def __init__(self, views: int) -> None:
        self.views = views

    def reg_image_ids(self) -> list[int]:
        return list(range(self.views))


@pytest.mark.parametrize(
    ("again", "explained", "taken"),
    [
        (40, 90, True),
        (40, 80, True),  # half as many unexplained
        (40, 79, False),
        (38, 100, True),
        (37, 100, False),  # more than a twentieth of the views lost
    ],
)
def test_other_poses_are_taken_where_they_explain_much_more(
    monkeypatch: pytest.MonkeyPatch, again: int, explained: int, taken: bool
) -> None:
    first, second = Model(40), Model(again)
    shares: dict[Any, int] = {first: 60, second: explained}
    monkeypatch.setattr(
        look_alikes, "count_explained", lambda _, m, __: {"pairs": 100, "explained": shares[m]}
    )
    state = Attempt(Job("", (), {}, 1), SfmConfig(), Answer("shared"), no_progress)
    found = pairs({(0, 1): 20, (1, 2): 2})
    asked: list[set[Pair]] = []

    def place_by(_: Any, those: dict[Pair, Verified]) -> Model:
        asked.append(set(those))
        return second if len(asked) > 1 else first

    model, kept = look_alikes.place(state, found, [], place_by)
    assert model is (second if taken else first)
    assert set(kept) == asked[1 if taken else 0]
    assert len(asked) == (2 if taken else 3)
    assert state.answer.beside_object == {"pairs": 100, "explained": shares[model]}
    assert bool(state.answer.fallbacks) is taken


@pytest.mark.parametrize(("before", "tries"), [(100, 1), (99, 2), (98, 2), (97, 3)])
def test_few_unexplained_pairs_are_worth_one_more_mapping(
    monkeypatch: pytest.MonkeyPatch, before: int, tries: int
) -> None:
    monkeypatch.setattr(
        look_alikes, "count_explained", lambda *_: {"pairs": 100, "explained": before}
    )
    state = Attempt(Job("", (), {}, 1), SfmConfig(), Answer("shared"), no_progress)
    asked: list[set[Pair]] = []

    def place_by(_: Any, those: dict[Pair, Verified]) -> Model:
        asked.append(set(those))
        return Model(40)

    look_alikes.place(state, pairs({(0, 1): 20}), [], place_by)
    assert len(asked) == tries


@pytest.mark.parametrize(("views", "taken"), [((30, 40), 2), ((None, 40), 2), ((30, 37), 0)])
def test_where_too_few_views_are_placed_little_is_enough_to_tie_a_view(
    monkeypatch: pytest.MonkeyPatch, views: tuple[int | None, int], taken: int
) -> None:
    first = Model(40)
    shares = {True: 60, False: 100}
    monkeypatch.setattr(
        look_alikes,
        "count_explained",
        lambda _, m, __: {"pairs": 100, "explained": shares[m is first]},
    )
    state = Attempt(Job("", (), {}, 1), SfmConfig(), Answer("shared"), no_progress)
    found = pairs({(0, 1): 20, (1, 2): 20, (2, 9): 3, (0, 9): 0})
    asked: list[set[Pair]] = []

    def place_by(_: Any, those: dict[Pair, Verified]) -> Model:
        asked.append(set(those))
        placed = (40, *views)[len(asked) - 1]
        if placed is None:
            raise StageError("no two views could be placed")
        return first if len(asked) == 1 else Model(placed)

    model, kept = look_alikes.place(state, found, [], place_by)
    assert asked == [set(found), set(found), {(0, 1), (1, 2), (2, 9)}]
    assert set(kept) == asked[taken]
    assert (model is first) is (taken == 0)


@pytest.mark.parametrize(("again", "taken"), [(6, True), (5, False), (None, False)])
def test_a_group_on_its_side_is_placed_apart_or_told(
    monkeypatch: pytest.MonkeyPatch, again: int | None, taken: bool
) -> None:
    """Six views stand upright and three on their side; pair (0, 6) ties them by the object."""
    cameras = dict(enumerate(box.orbit(9)))
    for view in (6, 7, 8):
        of_it = cameras[view]
        lying = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ of_it.rotation
        cameras[view] = replace(of_it, rotation=lying)
    monkeypatch.setattr("mattgs_ops.sfm.colmap.mapping.posed", lambda _: cameras)
    told = {"pairs": 8, "explained": 8, "groups": 2}
    monkeypatch.setattr(look_alikes, "count_explained", lambda *_: told)
    views = tuple(JobView(f"{k}.jpg", "", "", 8, 6, None, None) for k in range(9))
    state = Attempt(Job("", views, {}, 1), SfmConfig(), Answer("shared"), no_progress)
    groups = [(a, b) for those in (range(6), range(6, 9)) for a in those for b in those if a < b]
    found = pairs(dict.fromkeys(groups, 45) | {(0, 6): 0})
    models = [Model(9)]

    def place_by(_: Any, those: dict[Pair, Verified]) -> Model:
        if set(those) == set(groups):
            if again is None:
                raise StageError("no two views could be placed")
            models.append(Model(again))
        return models[-1]

    model, kept = look_alikes.place(state, found, [], place_by)
    assert model is models[-1 if taken else 0]
    assert set(kept) == (set(groups) if taken else set(found))
    (warning,) = look_alikes.warnings(state.answer)
    assert warning.startswith("6.jpg, 7.jpg, 8.jpg lie on their side")
    assert look_alikes.in_doubt(state.answer) is not taken


def test_groups_that_share_nothing_beside_the_object_confirm_no_cameras() -> None:
    told = {"pairs": 100, "explained": 100}
    assert look_alikes.confirmed(told)
    assert look_alikes.confirmed(told | {"groups": 1})
    assert not look_alikes.confirmed(told | {"groups": 2})
