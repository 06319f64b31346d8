"""When masks are in doubt, and what is said then."""

import re

import pytest

from mattgs_ops.object_masks.doubts import of_exposure, of_masks
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
    ],
)
def test_masks_that_contradict_each_other_or_the_network(
    change: dict[str, object], words: str
) -> None:
    (doubt,) = of_masks(report(), {"agreement": GOOD | change})
    assert doubt.serious
    assert re.search(words, doubt.text)


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


def test_a_dropped_view_is_told_and_no_reason_for_doubt() -> None:
    (doubt,) = of_masks(report(), {"agreement": GOOD, "dropped": ["7.jpg"]})
    assert not doubt.serious
    assert "7.jpg" in doubt.text


def test_photos_of_other_exposures_are_told_without_forbidding_a_verdict() -> None:
    third, stop = 2 ** (1 / 3 / 2.2), 2 ** (1 / 2.2)  # as factors of sRGB values
    assert of_exposure(third) == []
    (one,) = of_exposure(stop)
    assert (one.about, one.serious) == ("exposure", False)
    assert "exposure by up to 1.0 stops: compare colour-corrected scores" in one.text
