"""The mask report of a capture: what was cut out of each photo, and which photos look wrong."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mattgs_ops.capture.masks import Mask, MaskQuality
from mattgs_ops.errors import InputError

EMPTY_SHARE = 0.002  # of the photo; less can hardly hold an object that fills a capture
FULL_SHARE = 0.95
OUTLIER_FACTOR = 1.8  # against the median of the view's neighbours by name
NEIGHBOURS = 3  # to either side, around the orbit
FRAME_SHARE = 0.25  # of the photo's border under the mask: cut off, or background taken along


@dataclass(frozen=True)
class ViewReport:
    """One photo: foreground share 0..1, and flags.

    Flags are ``empty``, ``full``, ``outlier``, ``frame`` and ``differs`` (:func:`flags_of`), and
    ``contradicts``: other masks contradict it, at points that photos share
    (:mod:`mattgs_ops.segment.contradictions`) or by its outline.
    """

    name: str
    foreground: float
    flags: tuple[str, ...]
    quality: MaskQuality | None  # against the renderer's own mask, where there is one


@dataclass(frozen=True)
class MaskReport:
    """All photos of a capture; written as ``masks.json``."""

    source: str
    refine: str
    model: str | None  # SHA-256 of the network's file
    views: tuple[ViewReport, ...]

    @property
    def mean_iou(self) -> float | None:
        """Mean over the views whose true mask is known."""
        known = [view.quality.iou for view in self.views if view.quality]
        return float(np.mean(known)) if known else None

    @property
    def flagged(self) -> tuple[ViewReport, ...]:
        """Views that carry a flag."""
        return tuple(view for view in self.views if view.flags)

    def means(self) -> dict[str, float]:
        """Mean and worst scores over the views whose true mask is known; empty if none."""
        known = [view.quality.as_dict() for view in self.views if view.quality]
        if not known:
            return {}
        means = {key: float(np.mean([row[key] for row in known])) for key in known[0]}
        return {**means, "worst_iou": min(row["iou"] for row in known)}

    def save(self, path: Path) -> None:
        """Write JSON."""
        document = {"schema": 1, **asdict(self), "mean_iou": self.mean_iou, "means": self.means()}
        path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> "MaskReport":
        """Read JSON; raises :class:`InputError` naming the file."""
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            views = tuple(
                ViewReport(
                    row["name"],
                    row["foreground"],
                    tuple(row["flags"]),
                    MaskQuality(**row["quality"]) if row["quality"] else None,
                )
                for row in data["views"]
            )
            return cls(data["source"], data["refine"], data["model"], views)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: expected a mask report: {error!r}") from error


def flags_of(
    masks_shares: Sequence[float], frames: Sequence[float], differs: Sequence[bool] = ()
) -> list[tuple[str, ...]]:
    """Return flags by view from foreground shares and shares of the border that are foreground.

    A view is an outlier when its share differs from the median of its neighbours by name by more
    than ``OUTLIER_FACTOR`` either way: an orbit's silhouettes change slowly. ``differs`` says which
    masks share less with the network's own than they differ from it.
    """
    count = len(masks_shares)
    result = []
    for i, share in enumerate(masks_shares):
        flags = []
        if share < EMPTY_SHARE:
            flags.append("empty")
        if share > FULL_SHARE:
            flags.append("full")
        around = {(i + k) % count for k in range(-NEIGHBOURS, NEIGHBOURS + 1)} - {i}
        usual = float(np.median([masks_shares[k] for k in around])) if len(around) >= 2 else share
        if share > OUTLIER_FACTOR * usual or share * OUTLIER_FACTOR < usual:
            flags.append("outlier")
        if frames[i] > FRAME_SHARE:
            flags.append("frame")
        if any(differs[i : i + 1]):
            flags.append("differs")
        result.append(tuple(flags))
    return result


def border_share(mask: Mask) -> float:
    """Share of the outermost pixels that are foreground."""
    edge = np.concatenate([mask[0], mask[-1], mask[1:-1, 0], mask[1:-1, -1]])
    return float((edge > 0).mean())
