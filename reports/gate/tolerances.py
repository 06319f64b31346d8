"""The gate's one table of tolerances: what is judged, in which direction, by how much.

Margins are the smallest changes that somebody should look at; a verdict needs the whole interval
beyond its margin. ``noise`` is the standard deviation, between two runs of the same code and seed,
of one cell's number (its mean over views; for ratios its logarithm), where the rows themselves
cannot show it: one run is one sample. ``between`` is the same between runs that round differently,
as two kinds of processor do, and an edit that changes nothing else; a baseline may bring it,
measured. ``common`` is the part that all cells of a run share, which no number of cells averages
out.

The chance of a false alarm is bounded for a whole gate run, not per number: ``ALARM`` is shared out
among families, and within a family evenly among its numbers (Bonferroni).
"""

from dataclasses import dataclass
from enum import StrEnum

ALARM = 0.01  # chance that a gate run on unchanged code calls anything worse
# Shares of ALARM by (aspect, scope). Speed over all cells gets most: it is the noisiest and the
# one that a code change moves everywhere at once.
SHARES = {
    ("quality", "all"): 0.2,
    ("cost", "all"): 0.3,
    ("size", "all"): 0.1,
    ("quality", "cell"): 0.2,
    ("cost", "cell"): 0.1,
    ("size", "cell"): 0.1,
}
POOL_LEAST = 3  # cells from which a mean over all cells has an interval worth the name


class Doubt(StrEnum):
    """Which inconclusive numbers mean that nothing can be judged (exit code 2).

    ``ALL`` of them, and excused ones too; those whose estimate is a loss beyond its ``MARGIN``; or
    ``NONE``: they are printed only.
    """

    ALL = "all"
    MARGIN = "margin"
    NONE = "none"


@dataclass(frozen=True)
class Tolerance:
    """How one metric is judged.

    ``kind``: ``difference`` is paired by view and seed, margins in the metric's unit; ``ratio`` is
    relative, margins as a share; ``exact`` is one number of the whole row that one machine finds
    again to the bit; ``speed`` is a ratio of values divided by the calibration workload of their
    own process.
    """

    metric: str
    aspect: str
    direction: int
    kind: str
    margin: float
    noise: float = 0.0
    common: float = 0.0  # standard deviation of what all cells of a run share, likewise
    required: bool = True
    between: float | None = None  # None: nobody measured it
    upstream: bool = False  # says how good masks or poses are, whatever is scored with them


TOLERANCES: tuple[Tolerance, ...] = (
    Tolerance("psnr", "quality", +1, "difference", 0.1, 0.02),
    Tolerance("ssim", "quality", +1, "difference", 0.003, 0.0005),
    Tolerance("l1", "quality", -1, "difference", 0.001, 0.0002),
    Tolerance("mask_psnr", "quality", +1, "difference", 0.1, 0.02),
    Tolerance("mask_ssim", "quality", +1, "difference", 0.005, 0.001),
    Tolerance("mask_l1", "quality", -1, "difference", 0.002, 0.0004),
    Tolerance("paper_l1", "quality", -1, "difference", 0.0005, 0.0001, required=False),
    Tolerance("detail_psnr", "quality", +1, "difference", 0.15, 0.03, required=False),
    Tolerance("detail_ssim", "quality", +1, "difference", 0.005, 0.001, required=False),
    Tolerance("registered", "quality", +1, "exact", 0.0, upstream=True),
    Tolerance("mean_iou", "quality", +1, "exact", 0.005, required=False, upstream=True),
    Tolerance("time", "cost", -1, "speed", 0.02, 0.02, 0.01),
    Tolerance("fps", "cost", +1, "speed", 0.02, 0.02, 0.01),
    Tolerance("size_mb", "size", -1, "ratio", 0.05, 0.005),
    Tolerance("splats", "size", -1, "ratio", 0.05, 0.005),
)


def confidence(aspect: str, scope: str, checks: int) -> float:
    """Two-sided confidence of one number's interval, so that the family keeps to its share."""
    return 1 - 2 * ALARM * SHARES[aspect, scope] / max(1, checks)
