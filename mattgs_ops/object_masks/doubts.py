"""What a reader must know of a capture's masks, and whether they are in doubt.

``of_masks(report, extra)`` reads a mask report and what the scene says of the views' agreement. A
capture whose masks are in doubt gets no verdict: everything after masks is built on them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mattgs_ops.capture.scene import FROM_OBJECT
from mattgs_ops.naming import listed_names
from mattgs_ops.object_masks.silhouettes import CONTRADICT
from mattgs_ops.segment.contradictions import LEAST_SHARED
from mattgs_ops.segment.mask_report import FRAME_SHARE, MaskReport
from mattgs_ops.sfm.look_alikes import confirmed
from mattgs_ops.sfm.lost_views import MOST_VIEWS

MANY = 0.5  # of the views: a flag that more than half of them carry is the capture's
# Degrees between the two views that differ most. Silhouettes of radius r that are seen within an
# angle θ share what lies up to r / sin(θ / 2) behind the object; from this angle on that is within
# 2.5 radii, beyond which nothing joins an object (``attached_parts.FAR``).
ONE_SIDE = 2 * math.degrees(math.asin(1 / 2.5))
DIFFERENT_EXPOSURE = 0.5  # stops: cameras set exposure in steps of thirds
GAMMA = 2.2  # light is about the 2.2th power of an sRGB value (IEC 61966-2-1)
NAMED = 5  # views named in one sentence


@dataclass(frozen=True)
class Doubt:
    """A sentence about masks, poses or exposure (``about``); ``serious`` ones forbid a verdict."""

    about: str
    text: str
    serious: bool


def of_masks(report: MaskReport, extra: Mapping[str, Any]) -> list[Doubt]:
    """Return all doubts, serious ones first; ``extra`` is the scene's own."""
    agreement = extra.get("agreement") or {}
    texts = [*_contradictions(agreement), *_flooded(report)]
    doubts = [Doubt("masks", text, True) for text in texts]
    angle = agreement.get("seen_within")
    if angle is not None and angle < ONE_SIDE:
        text = (
            f"photos show the object from one side, within {angle:.0f} degrees: masks may hold "
            "what lies behind it, and no photo contradicts that; look at the sheet of masks"
        )
        doubts.append(Doubt("masks", text, False))
    dropped = list(extra.get("dropped") or ())
    if dropped:
        named = listed_names(dropped, NAMED)
        text = f"no object was found in {named}: nothing is trained or scored there"
        doubts.append(Doubt("masks", text, False))
    return doubts


def of_poses(extra: Mapping[str, Any]) -> list[Doubt]:
    """Return what to say of poses; ``extra`` is the scene's own."""
    serious = bool(extra.get("poses_in_doubt"))
    doubts = [Doubt("poses", text, serious) for text in extra.get("warnings") or ()]
    doubts += _through_cameras(extra)
    if any(FROM_OBJECT in step for step in extra.get("fallbacks") or ()):
        text = (
            "the object turns against what surrounds it, and poses hold for the object alone: with "
            "background a training sees contradictions, so compare conditions without it"
        )
        doubts.append(Doubt("poses", text, False))
    return doubts


def of_exposure(spread: float) -> list[Doubt]:
    """Return what to say of photos whose sRGB values differ by a factor of up to ``spread``."""
    stops = GAMMA * float(np.log2(spread))
    if stops < DIFFERENT_EXPOSURE:
        return []
    text = (
        f"photos differ in exposure by up to {stops:.1f} stops: compare colour-corrected scores, "
        "as plain ones count a test photo's own exposure"
    )
    return [Doubt("exposure", text, False)]


def _contradictions(agreement: Mapping[str, Any]) -> list[str]:
    """Say whether masks contradict each other, or the network's own."""
    none = str(agreement.get("none", ""))
    if "share no object" in none:
        return ["the photos' maps share no object"]
    notes = []
    if "silhouettes" in agreement:
        best = max(agreement["silhouettes"], agreement.get("votes") or 0.0)
        if best < CONTRADICT:
            notes.append(
                f"masks of different photos contradict each other: what the others say meets a "
                f"photo's own map with a mean IoU of {best:.2f}, below {CONTRADICT}"
            )
    share = (agreement.get("shared_points") or {}).get("share")
    if share is not None and share < LEAST_SHARED:
        notes.append(
            f"masks of different photos contradict each other: of the points that two photos show "
            f"and one mask holds, both masks hold {share:.0%}"
        )
    overlaps = list((agreement.get("overlap") or {}).values())
    if overlaps and float(np.mean(overlaps)) < CONTRADICT:
        notes.append(
            f"masks differ from the network's own: mean IoU {float(np.mean(overlaps)):.2f}, below "
            f"{CONTRADICT}"
        )
    return notes


def _through_cameras(extra: Mapping[str, Any]) -> list[Doubt]:
    """Say which masks the others contradict through the cameras, and which of both is why.

    More than a twentieth of them are as many as may have no camera at all before there is no
    verdict (:data:`MOST_VIEWS`).
    """
    agreement = extra.get("agreement") or {}
    outlines = agreement.get("shared_outlines") or {}
    names = list(outlines.get("contradict") or ())
    if not names:
        return []
    cameras_hold = confirmed(extra.get("beside_object") or {})
    points = agreement.get("shared_points") or {}
    agree = (points.get("share") or 0.0) >= LEAST_SHARED
    cause = "masks or cameras are wrong there"
    if cameras_hold:
        cause = "what photos share beside the object confirms the cameras, so the masks are wrong"
    elif agree and not set(names) & set(points.get("contradict") or ()):
        cause = (
            "the masks agree at the points that photos share, so the cameras are wrong, as where "
            "two sides of an object look alike: keep the room in the photos, or put something "
            "that is not symmetric beside the object"
        )
    text = (
        f"{len(names)} of {outlines['compared']} masks share less with what the others predict of "
        f"them through the cameras than they differ, {listed_names(names, NAMED)}: {cause}"
    )
    serious = len(names) > (1 - MOST_VIEWS) * outlines["compared"]
    return [Doubt("masks" if cameras_hold else "poses", text, serious)]


def _flooded(report: MaskReport) -> list[str]:
    """Say whether masks cover the frame; masks that are meant to are not checked."""
    if report.source == "none":
        return []
    flooded = [view.name for view in report.views if {"frame", "full"} & set(view.flags)]
    if len(flooded) <= MANY * len(report.views):
        return []
    text = f"masks cover more than {FRAME_SHARE:.0%} of the photo's border in"
    return [f"{text} {len(flooded)} of {len(report.views)} photos"]
