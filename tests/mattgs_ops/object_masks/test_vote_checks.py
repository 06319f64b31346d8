"""Votes that do not make the masks of a view, or of the capture though they are the best."""

from dataclasses import replace

import numpy as np
import pytest

from mattgs_ops.object_masks.corrected_maps import averaged
from mattgs_ops.object_masks.decision import decide
from mattgs_ops.object_masks.silhouettes import CONTRADICT, Silhouettes, iou
from mattgs_ops.object_masks.vote_checks import _unlike_trained
from tests.mattgs_ops.object_masks.ball import HEIGHT, VIEWS, WIDTH, notched
from tests.mattgs_ops.object_masks.test_decision import TRUTHS, grown, photos, views_of, votes

SPECKLED = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
TRAINED = [0.90, 0.80, 0.86, 0.84]  # by votes, where silhouettes meet all maps to 0.9


@pytest.mark.parametrize(
    ("by_votes", "by_outline", "by_both", "strange"),
    [
        (0.79, 0.9, 0.9, False),  # the lowest of all five, and of the same kind
        (0.50, 0.9, 0.5, True),
        (0.50, 0.9, 0.91, False),  # silhouettes and votes say the same: its map is wrong
        (0.50, 0.49, 0.3, False),  # its map contradicts the silhouettes: it is not counted
        (0.51, 0.5, 0.3, False),  # splats that are no worse than silhouettes are not worse
    ],
)
def test_a_held_out_view_is_strange_beyond_what_further_views_would_show(
    by_votes: float, by_outline: float, by_both: float, strange: bool
) -> None:
    votes, outlines = [*TRAINED, by_votes], [0.9] * len(TRAINED) + [by_outline]
    both = [0.9] * len(TRAINED) + [by_both]
    assert _unlike_trained(votes, outlines, both, range(4)) == [False] * 4 + [strange]


def test_views_that_are_trained_on_are_never_strange() -> None:
    assert not any(_unlike_trained([*TRAINED, 0.1], [0.9] * 5, [0.1] * 5, range(5)))


def test_among_many_held_out_views_one_may_be_low_by_chance() -> None:
    """What is strange of one is not of the lowest of thirty."""
    low = 0.70
    assert _unlike_trained([*TRAINED, low], [0.9] * 5, [0.5] * 5, range(4))[-1]
    many = _unlike_trained([*TRAINED, *[0.85] * 29, low], [0.9] * 34, [0.5] * 34, range(4))
    assert not many[-1]


def test_without_training_views_nobody_knows() -> None:
    assert _unlike_trained([0.1], [0.9], [0.1], []) == [False]


def test_a_held_out_map_that_leaks_is_replaced_by_votes_which_silhouettes_confirm() -> None:
    own = [t.copy() for t in TRUTHS]
    own[5] = grown(TRUTHS[5], 5)
    met = Silhouettes([grown(t, 1) for t in TRUTHS], [0.9] * VIEWS, 1.0)
    views = views_of([SPECKLED] * VIEWS, own, met, [index != 5 for index in range(VIEWS)])
    found, maps = decide(views, votes(TRUTHS, TRUTHS))
    assert CONTRADICT < iou(own[5] > 0, TRUTHS[5] > 0) < views.by_outline[5]
    assert found.views[5].masks == "votes"
    assert np.array_equal(maps[5], TRUTHS[5])


@pytest.mark.parametrize("final", [True, False])
@pytest.mark.parametrize("own_lack", [True, False])
def test_the_best_votes_make_no_masks_where_maps_predict_each_other_better(
    final: bool, own_lack: bool
) -> None:
    """One of the two lacks another part of the ball in each view; photos have edges everywhere."""
    lacking = notched(TRUTHS)
    own, sure = (lacking, TRUTHS) if own_lack else (TRUTHS, lacking)
    low = Silhouettes([t * 0 for t in TRUTHS], [0.0] * VIEWS, 1.0)
    found, maps = decide(views_of([SPECKLED] * VIEWS, own, low), votes(own, sure), final=final)
    kept = final and not own_lack
    assert found.masks == ("maps" if kept else "votes")
    assert ("surely less" in found.reason) is kept
    assert (iou(maps[3] >= 0.5, TRUTHS[3] >= 0.5) > 0.95) is (kept or own_lack)


def test_votes_that_predict_each_other_less_and_lie_on_edges_more_are_averaged_with_maps() -> None:
    """The maps fill a notch of the ball, which another place of it has in each view."""
    lacking, pictures = notched(TRUTHS), []
    for soft in lacking:
        photo = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
        photo[soft > 0] = [40, 90, 160]
        pictures.append(photo)
    low = Silhouettes([t * 0 for t in TRUTHS], [0.0] * VIEWS, 1.0)
    views = views_of(pictures, TRUTHS, low)
    assert np.mean(views.worths(lacking)) < np.mean(views.own_worths)
    found, _ = decide(views, votes(TRUTHS, lacking), final=True)
    assert found.masks == "both"
    assert "surely less, but their outlines surely lie on edges more" in found.reason


def test_votes_and_maps_that_are_worth_the_same_are_averaged() -> None:
    """Maps are too wide in every other view, votes in the rest; both are sure of what they show."""
    wide = [grown(t, 2) for t in TRUTHS]
    own, sure = (
        [one if k % 2 == odd else t for k, (one, t) in enumerate(zip(wide, TRUTHS, strict=True))]
        for odd in range(2)
    )
    views = views_of([SPECKLED] * VIEWS, own, Silhouettes(own, [0.5] * VIEWS, 1.0))
    found, maps = decide(views, votes(own, sure), final=True)
    assert found.masks == "both"
    assert {view.masks for view in found.views} == {"both"}
    assert "neither is surely better" in found.reason
    maps_worth, votes_worth = (
        float(np.mean(one)) for one in (views.own_worths, views.worths(sure))
    )
    for one, mean in zip(maps, averaged(own, sure, maps_worth, votes_worth), strict=True):
        np.testing.assert_array_equal(one, mean)


@pytest.mark.parametrize(("step", "masks"), [(0.0, "maps"), (0.2, "votes")])
def test_votes_that_meet_maps_a_little_less_are_refused_where_all_views_say_so(
    step: float, masks: str
) -> None:
    """On average 0.05 less than silhouettes: in every view, or in half of them."""
    own = [grown(t, 1) for t in TRUTHS]
    met = [iou(a > 0, b > 0) for a, b in zip(TRUTHS, own, strict=True)]
    outlines = Silhouettes(TRUTHS, met, 1.0)
    less = [one - 0.05 + (step if k % 2 else -step) for k, one in enumerate(met)]
    found, _ = decide(views_of(photos(), own, outlines), replace(votes(own, own), agreement=less))
    assert found.confirmed["votes"] == found.confirmed["maps"]
    assert found.votes == pytest.approx(found.silhouettes - 0.05)
    assert found.masks == masks


@pytest.mark.parametrize(("meet", "masks"), [(0.45, "votes"), (0.55, "maps")])
def test_to_meet_maps_that_contradict_each_other_is_no_merit(meet: float, masks: str) -> None:
    """Each map shows another fragment; votes meet them less, and predict each other better."""
    fragments = [t.copy() for t in TRUTHS]
    for k, soft in enumerate(fragments):
        soft[: HEIGHT // 2] *= k % 2
        soft[HEIGHT // 2 :] *= 1 - k % 2
    views = views_of([SPECKLED] * VIEWS, fragments, Silhouettes(fragments, [meet] * VIEWS, 1.0))
    meeting_less = replace(votes(fragments, TRUTHS), agreement=[0.4] * VIEWS)
    assert decide(views, meeting_less, final=True)[0].masks == masks
