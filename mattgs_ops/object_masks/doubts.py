"""What a reader must know of a capture's masks, and whether they are in doubt.

``of_masks(report, extra)`` reads a mask report and what the scene says of the views' agreement. A
capture whose masks are in doubt gets no verdict: everything after masks is built on them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mattgs_ops.capture.scene import FROM_OBJECT
from mattgs_ops.naming import listed_names
from mattgs_ops.object_masks.silhouettes import CONTRADICT
from mattgs_ops.segment.contradictions import LEAST_SHARED
from mattgs_ops.segment.mask_report import FRAME_SHARE, MaskReport

MANY = 0.5  # of the views: a flag that more than half of them carry is the capture's
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


def _flooded(report: MaskReport) -> list[str]:
    """Say whether masks cover the frame; masks that are meant to are not checked."""
    if report.source == "none":
        return []
    flooded = [view.name for view in report.views if {"frame", "full"} & set(view.flags)]
    if len(flooded) <= MANY * len(report.views):
        return []
    text = f"masks cover more than {FRAME_SHARE:.0%} of the photo's border in"
    return [f"{text} {len(flooded)} of {len(report.views)} photos"]
