"""Columns: how each number is called, rounded and judged. Text in, text out; no data.

``kind`` decides the rounding; ``direction`` is +1 where more is better, −1 where less is, 0 where
neither is. What metrics are called, and which way they are judged, says the table of metrics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mattgs_ops.score.metric_table import METRICS

MINUTE, HOUR = 60, 3600


@dataclass(frozen=True)
class Column:
    """One column: ``key`` is the metric's id in a row.

    ``across``: whether its values compare across backgrounds, too (docs/protocol.md).
    """

    key: str
    label: str
    direction: int
    kind: str
    across: bool = False

    @property
    def arrow(self) -> str:
        """↑, ↓ or nothing."""
        return {1: "↑", -1: "↓", 0: ""}[self.direction]

    @property
    def heading(self) -> str:
        """The label with its arrow; units stay outside, as the paper prints ``Size(MB)↓``."""
        return self.label + self.arrow


# decimals by kind; `time` and `text` are their own
DECIMALS = {"ssim": 3, "db": 2, "l1": 4, "rate": 1, "mb": 2, "count": 0, "share": 3, "ratio": 2}


def _column(key: str, kind: str, *, across: bool = False) -> Column:
    metric = METRICS[key]
    return Column(key, metric.label, metric.direction, kind, across)


PAPER = (
    _column("ssim", "ssim"),
    _column("psnr", "db"),
    _column("l1", "l1"),
    _column("loss", "l1"),
    _column("fps", "rate", across=True),
    _column("time", "time", across=True),
    _column("size_mb", "mb", across=True),
)
CPU_TIME = _column("time_cpu", "time", across=True)
IN_MASK = (
    _column("mask_psnr", "db", across=True),
    _column("mask_cc_psnr", "db", across=True),
    _column("mask_ssim", "ssim"),
    _column("mask_l1", "l1", across=True),
    _column("detail_psnr", "db", across=True),
    _column("detail_ssim", "ssim"),
    _column("splats", "count"),
)
# One name for each part of the object: `mask_` whole, `core_` free of silhouettes, `rim_` the rest
CORE_AND_RIM = (
    _column("core_psnr", "db", across=True),
    _column("rim_psnr", "db", across=True),
    _column("core_ssim", "ssim", across=True),
    _column("rim_ssim", "ssim"),
    _column("core_l1", "l1", across=True),
    _column("rim_l1", "l1", across=True),
)
COLOUR_CORRECTED = _column("cc_psnr", "db")
PERCEPTUAL = (
    _column("flip", "l1"),
    _column("mask_flip", "l1"),
    _column("core_flip", "l1"),
    _column("rim_flip", "l1"),
    _column("detail_flip", "l1"),
    _column("lpips", "l1"),
    COLOUR_CORRECTED,
)
TRAINING = tuple(
    replace(_column(key, kind), key=f"train_{key}")  # under the names that held-out views have
    for key, kind in (
        ("ssim", "ssim"),
        ("psnr", "db"),
        ("l1", "l1"),
        ("loss", "l1"),
        ("paper_l1", "l1"),
        ("paper_loss", "l1"),
    )
)


def text(kind: str, value: float) -> str:
    """Round a number as its column prints it."""
    if kind == "time":
        return duration(value)
    if kind == "count":
        return f"{round(value):,}"
    return f"{value:.{DECIMALS[kind]}f}"


def signed(value: float, decimals: int = 2) -> str:
    """Round with a sign, a true minus among them; what rounds to zero has none."""
    text = f"{value:+.{decimals}f}"
    return text.replace("-", "−") if float(text) else text[1:]


def signed_text(kind: str, value: float) -> str:
    """Round as a column does, with a sign as :func:`signed` gives one."""
    shown = text(kind, abs(value))
    return shown if shown == text(kind, 0.0) else ("−" if value < 0 else "+") + shown


def joined(parts: Sequence[str]) -> str:
    """Join as a sentence does: a, b and c."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def duration(seconds: float) -> str:
    """Seconds as ``1h 02m 03s``, ``13m 10s``, ``42 s`` or, below ten seconds, ``4.2 s``."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    total = round(seconds)
    if total < MINUTE:
        return f"{total} s"
    if total < HOUR:
        return f"{total // MINUTE}m {total % MINUTE:02d}s"
    return f"{total // HOUR}h {total % HOUR // MINUTE:02d}m {total % MINUTE:02d}s"


def roman(number: int) -> str:
    """Write a table's number as the paper does: I, II, III."""
    out = ""
    for value, letters in ((10, "X"), (9, "IX"), (5, "V"), (4, "IV"), (1, "I")):
        while number >= value:
            out, number = out + letters, number - value
    return out
