"""Why views could not be placed, and whether they form a second group: said in words.

Incremental mapping places a view when it shares enough points with those already placed. A view is
lost because it shows too little, because no photo matches it, because only other lost views do, or
because its matches were too few or did not agree. Views that match each other but nothing else end
in a model of their own, whose place relative to the first nobody knows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.naming import listed_names
from mattgs_ops.sfm.colmap.job import Answer, Job
from mattgs_ops.sfm.colmap.moving_object import STANDS_STILL

FEW_KEYPOINTS = 60  # COLMAP places an image on 30 inliers; twice as many are the least to hope for
# Below this share of the views a second attempt is made, and what comes out is still in doubt.
MOST_VIEWS = 0.95
# What is to be done where poses come from an object that turns before a camera
OBJECT_TURNS = (
    "the camera stands still before an object that turns, and poses come from its own key points "
    "alone: take photos at every 10 degrees or less, or walk around it"
)
MOST_NAMED = 3  # partners in one reason
MOST_LISTED = 8  # views in one warning
WITHOUT_CAMERA = "came without a camera"
UNMATCHED = "is matched by no other photo (too far from its neighbours, or another scene)"
ONLY_GROUP = "matches only photos of a second group"
ONLY_LOST = "matches only photos that were not placed either"
# of several views that are lost for one reason
OF_SEVERAL = {
    WITHOUT_CAMERA: WITHOUT_CAMERA,
    UNMATCHED: "are matched by no other photo (too far from their neighbours, or another scene)",
    ONLY_GROUP: "match only photos of a second group",
    ONLY_LOST: "match only photos that were not placed either",
}


@dataclass(frozen=True)
class LostView:
    """A view without a camera; ``matched`` are the photos that match it best, with inliers."""

    name: str
    keypoints: int
    masked: int
    matched: tuple[tuple[str, int], ...]
    reason: str

    def to_json(self) -> dict[str, Any]:
        """Return it as ``scene.json`` holds it."""
        return vars(self) | {"matched": [list(pair) for pair in self.matched]}


def lost_views(capture: PreparedCapture, answer: Answer) -> list[LostView]:
    """Return the views that were not placed, in the capture's order, each with the reason."""
    placed = set(answer.registered)
    groups = second_groups(answer)
    out = []
    for view in capture.views:
        if view.name in placed:
            continue
        keypoints, masked = answer.keypoints.get(view.name, (0, 0))
        matched = tuple(answer.partners.get(view.name, ()))
        group = next((group for group in groups if view.name in group), None)
        sought = view.name in answer.keypoints
        reason = WITHOUT_CAMERA if not sought else _reason(keypoints, matched, placed, group)
        out.append(LostView(view.name, keypoints, masked, matched[:MOST_NAMED], reason))
    return out


def second_groups(answer: Answer) -> list[list[str]]:
    """Return the views of all models but the first that are not in the first, largest first."""
    placed = set(answer.registered)
    groups = [[name for name in group if name not in placed] for group in answer.components[1:]]
    return [group for group in groups if len(group) > 1]


def warnings(capture: PreparedCapture, answer: Answer) -> list[str]:
    """Return what a reader of any result of this capture must know: none if all were placed."""
    lost = lost_views(capture, answer)
    if not lost:
        return []
    total = len(capture.views)
    test = {view.name for view in capture.views if view.split == "test"}
    held_out = sum(view.name in test for view in lost)
    tests = f", {held_out} of them held out" if held_out else ""
    first = (
        f"only {total - len(lost)} of {total} views have a camera; nothing is trained or scored at "
        f"the others{tests}: {_listed(lost)}"
    )
    out = [first]
    for group in second_groups(answer):
        names = listed_names(group, MOST_LISTED)
        out.append(
            f"{len(group)} views form a second group that nothing ties to the first: {names}; take "
            "photos between the two, or run them as a capture of their own"
        )
    return out + advice(answer)


def _listed(lost: Sequence[LostView]) -> str:
    """Say of each view why it is lost; of those that are lost for one reason, once."""
    by_reason: dict[str, list[LostView]] = {}
    for view in lost:
        shared = next((one for one in OF_SEVERAL if view.reason.startswith(one)), view.name)
        by_reason.setdefault(shared, []).append(view)
    told = [
        f"{views[0].name} {views[0].reason}"
        if len(views) == 1
        else f"{listed_names([view.name for view in views], MOST_LISTED)} {OF_SEVERAL[reason]}"
        for reason, views in by_reason.items()
    ]
    more = len(told) - MOST_LISTED
    return "; ".join(told[:MOST_LISTED]) + (f"; and {more} more" if more > 0 else "")


def advice(answer: Answer) -> list[str]:
    """Return what to do about views without a camera, where the way they were taken says it."""
    still = any(step.startswith(STANDS_STILL) for step in answer.fallbacks)
    return [OBJECT_TURNS] if still else []


def of_exif(job: Job) -> list[str]:
    """Return what to do where too few views got a camera, and EXIF's focal length may be why."""
    told = job.exif_focal
    first = f"all attempts but the last started from {told}"
    return [f"{first}: where it is wrong, remove it from the photos"] if told else []


def in_doubt(capture: PreparedCapture, answer: Answer) -> bool:
    """Say whether too few views were placed for a verdict on this capture."""
    return len(answer.registered) < MOST_VIEWS * len(capture.views)


def _reason(
    keypoints: int,
    matched: Sequence[tuple[str, int]],
    placed: set[str],
    group: Sequence[str] | None,
) -> str:
    if keypoints < FEW_KEYPOINTS:
        return f"shows only {keypoints} key points (blurred, dark or without texture)"
    if not matched:
        return UNMATCHED
    ties = [(name, count) for name, count in matched if name in placed]
    if ties:
        return f"matches {_named(ties)}, too few or too contradictory to place it"
    best = _named(matched)
    if group is not None:
        return f"{ONLY_GROUP}, {best}"
    return f"{ONLY_LOST}, {best}"


def _named(matched: Sequence[tuple[str, int]]) -> str:
    return " and ".join(f"{name} ({count} points)" for name, count in matched[:MOST_NAMED])
