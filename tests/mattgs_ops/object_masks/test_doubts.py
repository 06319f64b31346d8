"""When masks are in doubt, and what is said then."""

import math
import re

import pytest

from mattgs_ops.capture.scene import FROM_OBJECT
from mattgs_ops.object_masks.doubts import ONE_SIDE, of_exposure, of_masks, of_poses
from mattgs_ops.object_masks.splats.attached_parts import FAR
from mattgs_ops.segment.mask_report import MaskReport, ViewReport

GOOD = {"silhouettes": 0.8, "votes": 0.9, "overlap": {"a": 0.9, "b": 0.7}}


def report(flags: tuple[tuple[str, ...], ...] = ((), (), ()), source: str = "u2net") -> MaskReport:
    views = tuple(ViewReport(f"{i}.jpg", 0.3, flag, None) for i, flag in enumerate(flags))
    return MaskReport(source, "votes", None, views)


def test_masks_that_agree_are_not_in_doubt() -> None:
    assert of_masks(report(), {"agreement": GOOD, "dropped": []}) == []
    assert of_masks(report(), {}) == []
    assert of_masks(report((("frame",), (), ())), {"agreement": GOOD}) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"silhouettes": 0.4, "votes": 0.45}, "contradict each other: .* 0.45"),
        ({"silhouettes": 0.4, "votes": None}, "contradict each other: .* 0.40"),
        ({"overlap": {"a": 0.3, "b": 0.5}}, "differ from the network's own: mean IoU 0.40"),
        ({"shared_points": {"share": 0.44}}, "contradict each other: .* both masks hold 44%"),
    ],
)
def test_masks_that_contradict_each_other_or_the_network(
    change: dict[str, object], words: str
) -> None:
    (doubt,) = of_masks(report(), {"agreement": GOOD | change})
    assert doubt.serious
    assert re.search(words, doubt.text)


@pytest.mark.parametrize(
    ("agreement", "doubted"),
    [
        ({"silhouettes": 0.49, "votes": 0.5}, False),
        ({"silhouettes": 0.5, "votes": 0.1}, False),
        ({"silhouettes": 0.49, "votes": 0.49}, True),
        ({"overlap": {"a": 0.9, "b": 0.45, "c": 0.2}}, False),  # on average 0.52
        ({"overlap": {"a": 0.9, "b": 0.45, "c": 0.1}}, True),  # 0.48
        ({"shared_points": {"share": 0.5}}, False),
        ({"shared_points": {"share": 0.49}}, True),
        ({"shared_points": {"share": None}}, False),  # too few points to tell
    ],
)
def test_agreement_is_in_doubt_below_a_half(agreement: dict[str, object], doubted: bool) -> None:
    assert bool(of_masks(report(), {"agreement": GOOD | agreement})) is doubted


@pytest.mark.parametrize(
    ("angle", "told"), [(13.0, True), (47.0, True), (47.3, False), (None, False)]
)
def test_photos_of_one_side_are_told_and_forbid_no_verdict(angle: float | None, told: bool) -> None:
    """sin(47.2° / 2) = 1 / 2.5: what lies farther behind is in no silhouette of both."""
    doubts = of_masks(report(), {"agreement": GOOD | {"seen_within": angle}})
    assert [doubt.serious for doubt in doubts] == [False] * told
    assert all("from one side, within" in doubt.text for doubt in doubts)
    assert math.sin(math.radians(ONE_SIDE / 2)) == pytest.approx(1 / FAR)


def test_maps_that_share_no_object() -> None:
    none = {"none": "the photos' maps share no object"}
    assert [doubt.serious for doubt in of_masks(report(), {"agreement": none})] == [True]
    given = {"none": "masks are given, nothing to vote on"}
    assert of_masks(report(), {"agreement": given}) == []


def test_masks_that_cover_the_frame_unless_they_are_meant_to() -> None:
    flags = (("frame",), ("full", "frame"), ())
    (doubt,) = of_masks(report(flags), {"agreement": GOOD})
    assert doubt.serious
    assert "2 of 3 photos" in doubt.text
    assert of_masks(report(flags, source="none"), {}) == []


@pytest.mark.parametrize(("count", "doubted"), [(5, False), (6, True)])
def test_a_flag_of_more_than_half_of_the_views_is_the_captures(count: int, doubted: bool) -> None:
    flags = (("frame",),) * count + ((),) * (10 - count)
    assert bool(of_masks(report(flags), {"agreement": GOOD})) is doubted


def test_a_dropped_view_is_told_and_no_reason_for_doubt() -> None:
    (doubt,) = of_masks(report(), {"agreement": GOOD, "dropped": ["7.jpg"]})
    assert not doubt.serious
    assert "7.jpg" in doubt.text


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (1, "found in 0.jpg: nothing"),
        (5, "0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg: nothing"),
        (6, "3.jpg, 4.jpg and 1 more: nothing"),
        (8, "3.jpg, 4.jpg and 3 more: nothing"),
    ],
)
def test_five_dropped_views_are_named_and_the_others_counted(count: int, words: str) -> None:
    dropped = [f"{index}.jpg" for index in range(count)]
    (doubt,) = of_masks(report(), {"agreement": GOOD, "dropped": dropped})
    assert words in doubt.text
    assert "5.jpg" not in doubt.text


def spread(stops: float) -> float:
    """Return the factor between sRGB values of photos that are so many stops apart."""
    return float(2 ** (stops / 2.2))


@pytest.mark.parametrize(("stops", "told"), [(1 / 3, False), (0.49, False), (0.51, True)])
def test_exposures_are_told_from_half_a_stop_on(stops: float, told: bool) -> None:
    assert bool(of_exposure(spread(stops))) is told


def test_poses_of_the_object_alone_are_told_without_forbidding_a_verdict() -> None:
    step = f"the object moves against its surroundings: {FROM_OBJECT}"
    (one,) = of_poses({"fallbacks": ["fainter key points sought", step]})
    assert (one.about, one.serious) == ("poses", False)
    assert "compare conditions without it" in one.text
    assert of_poses({"fallbacks": ["fainter key points sought"]}) == []


def test_views_without_a_pose_are_told_and_too_many_forbid_a_verdict() -> None:
    for doubted in (False, True):
        (one,) = of_poses({"warnings": ["only 4 of 8 views"], "poses_in_doubt": doubted})
        assert (one.about, one.text, one.serious) == ("poses", "only 4 of 8 views", doubted)


def test_photos_of_other_exposures_are_told_without_forbidding_a_verdict() -> None:
    (one,) = of_exposure(spread(1.0))
    assert (one.about, one.serious) == ("exposure", False)
    assert "exposure by up to 1.0 stops: compare colour-corrected scores" in one.text


@pytest.mark.parametrize(("count", "serious"), [(1, False), (2, False), (3, True)])
def test_masks_that_the_cameras_contradict_are_told_and_more_than_a_twentieth_forbid_a_verdict(
    count: int, serious: bool
) -> None:
    names = [f"{index}.jpg" for index in range(count)]
    outlines = {"mean": 0.8, "compared": 40, "contradict": names}
    (one,) = of_poses({"agreement": GOOD | {"shared_outlines": outlines}})
    assert (one.about, one.serious) == ("poses", serious)
    assert f"{count} of 40 masks share less" in one.text
    assert ", ".join(names) in one.text


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ({"share": 0.99, "contradict": []}, "the cameras are wrong, as where two sides"),
        ({"share": 0.99, "contradict": ["0.jpg"]}, "masks or cameras are wrong"),
        ({"share": 0.4, "contradict": []}, "masks or cameras are wrong"),
        ({"share": None, "contradict": []}, "masks or cameras are wrong"),
    ],
)
def test_cameras_are_to_blame_where_masks_agree_at_shared_points(
    points: dict[str, object], words: str
) -> None:
    outlines = {"mean": 0.8, "compared": 40, "contradict": ["0.jpg"]}
    agreement = GOOD | {"shared_outlines": outlines, "shared_points": points}
    (one,) = of_poses({"agreement": agreement})
    assert words in one.text


@pytest.mark.parametrize(
    ("pairs", "explained", "about"), [(20, 20, "masks"), (20, 18, "masks"), (20, 17, "poses")]
)
def test_masks_are_to_blame_where_what_stands_beside_the_object_confirms_cameras(
    pairs: int, explained: int, about: str
) -> None:
    points = {"share": 0.99, "contradict": []}
    outlines = {"mean": 0.8, "compared": 40, "contradict": ["0.jpg"]}
    agreement = GOOD | {"shared_outlines": outlines, "shared_points": points}
    told = {"pairs": pairs, "explained": explained}
    (one,) = of_poses({"agreement": agreement, "beside_object": told})
    assert one.about == about
    assert f"so the {'masks' if about == 'masks' else 'cameras'} are wrong" in one.text


def test_cameras_of_groups_that_share_nothing_beside_the_object_are_not_confirmed() -> None:
    outlines = {"mean": 0.8, "compared": 40, "contradict": ["0.jpg"]}
    told = {"pairs": 20, "explained": 20, "groups": 2}
    (one,) = of_poses({"agreement": GOOD | {"shared_outlines": outlines}, "beside_object": told})
    assert one.about == "poses"
    assert "masks or cameras are wrong" in one.text


def test_masks_without_outlines_in_common_say_nothing_of_cameras() -> None:
    for outlines in (None, {"mean": 0.9, "compared": 9, "contradict": []}):
        assert of_poses({"agreement": {"shared_outlines": outlines}}) == []
    assert of_poses({"agreement": None}) == []
