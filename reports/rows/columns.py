"""Columns: how each number is called, rounded and judged. Text in, text out; no data.

``kind`` decides the rounding; ``direction`` is +1 where more is better, −1 where less is, 0 where
neither is.
"""

from dataclasses import dataclass

MINUTE, HOUR = 60, 3600


@dataclass(frozen=True)
class Column:
    """One column: ``key`` is the metric's id in a row."""

    key: str
    label: str
    direction: int
    kind: str

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

PAPER = (
    Column("ssim", "SSIM", +1, "ssim"),
    Column("psnr", "PSNR", +1, "db"),
    Column("l1", "L1", -1, "l1"),
    Column("loss", "Loss", -1, "l1"),
    Column("fps", "FPS", +1, "rate"),
    Column("time", "Time", -1, "time"),
    Column("size_mb", "Size(MB)", -1, "mb"),
)
IN_MASK = (
    Column("mask_psnr", "PSNR in mask", +1, "db"),
    Column("mask_cc_psnr", "PSNR in mask, colour-corrected", +1, "db"),
    Column("cc_psnr", "PSNR, colour-corrected", +1, "db"),
    Column("mask_ssim", "SSIM in mask", +1, "ssim"),
    Column("mask_l1", "L1 in mask", -1, "l1"),
    Column("detail_psnr", "PSNR small parts", +1, "db"),
    Column("detail_ssim", "SSIM small parts", +1, "ssim"),
    Column("splats", "Splats", 0, "count"),
)
# One name for each part of the object: `mask_` whole, `core_` free of silhouettes, `rim_` the rest
CORE_AND_RIM = (
    Column("core_psnr", "PSNR in core", +1, "db"),
    Column("rim_psnr", "PSNR on rim", +1, "db"),
    Column("core_ssim", "SSIM in core", +1, "ssim"),
    Column("rim_ssim", "SSIM on rim", +1, "ssim"),
    Column("core_l1", "L1 in core", -1, "l1"),
    Column("rim_l1", "L1 on rim", -1, "l1"),
)
PERCEPTUAL = (
    Column("flip", "FLIP", -1, "l1"),
    Column("mask_flip", "FLIP in mask", -1, "l1"),
    Column("core_flip", "FLIP in core", -1, "l1"),
    Column("rim_flip", "FLIP on rim", -1, "l1"),
    Column("detail_flip", "FLIP small parts", -1, "l1"),
    Column("lpips", "LPIPS", -1, "l1"),
)
TRAINING = (
    Column("train_ssim", "SSIM", +1, "ssim"),
    Column("train_psnr", "PSNR", +1, "db"),
    Column("train_l1", "L1", -1, "l1"),
    Column("train_loss", "Loss", -1, "l1"),
    Column("train_paper_l1", "L1 (eq. 15)", -1, "l1"),
    Column("train_paper_loss", "Loss (eq. 15)", -1, "l1"),
)


def text(kind: str, value: float) -> str:
    """Round a number as its column prints it."""
    if kind == "time":
        return duration(value)
    if kind == "count":
        return f"{round(value):,}"
    return f"{value:.{DECIMALS[kind]}f}"


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
