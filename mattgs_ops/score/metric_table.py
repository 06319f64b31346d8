"""What is measured: a table of metrics, which needs no library to read.

``metrics.py`` computes those of images.
"""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Metric:
    """A row of the table.

    ``direction``: +1 more is better, −1 less is, 0 neither. ``version`` is raised when the meaning
    of the number changes: values of different versions do not compare. ``decimals``: as printed.
    """

    id: str
    label: str
    direction: int
    unit: str
    decimals: int
    description: str
    version: int = 1


# Nobody knows the details of training views, and haze is what those do not see
HELD_OUT_ONLY = ("haze", "mask_haze", "detail_psnr", "detail_ssim", "detail_flip")
PARTS = ("mask", "core", "rim")  # of an object: whole, core, rim

_IMAGE = (
    Metric("ssim", "SSIM", +1, "", 3, "structural similarity, full frame"),
    Metric("psnr", "PSNR", +1, "dB", 2, "peak signal-to-noise ratio, full frame"),
    Metric("l1", "L1", -1, "", 4, "mean absolute difference, full frame, not weighted"),
    Metric("loss", "Loss", -1, "", 4, "(1 - λ) L1 + λ (1 - SSIM), not weighted"),
    Metric("paper_l1", "L1 (eq. 15)", -1, "", 4, "mean of attention times absolute difference"),
    Metric("paper_loss", "Loss (eq. 15)", -1, "", 4, "the loss with the weighted L1"),
    Metric("mask_psnr", "PSNR in mask", +1, "dB", 2, "PSNR over the object's pixels"),
    # version 1 was averaged over what is the core now
    Metric("mask_ssim", "SSIM in mask", +1, "", 3, "SSIM's map over the object's pixels", 2),
    Metric("mask_l1", "L1 in mask", -1, "", 4, "mean absolute difference over the object's pixels"),
    Metric("core_psnr", "PSNR in core", +1, "dB", 2, "PSNR over the object's core"),
    Metric("core_ssim", "SSIM in core", +1, "", 3, "SSIM's map over the object's core"),
    Metric("core_l1", "L1 in core", -1, "", 4, "mean absolute difference over the object's core"),
    Metric("rim_psnr", "PSNR on rim", +1, "dB", 2, "PSNR over the object's rim"),
    Metric("rim_ssim", "SSIM on rim", +1, "", 3, "SSIM's map over the object's rim"),
    Metric("rim_l1", "L1 on rim", -1, "", 4, "mean absolute difference over the object's rim"),
    Metric("flip", "FLIP", -1, "", 4, "FLIP's map, how different it looks, over the full frame"),
    Metric("mask_flip", "FLIP in mask", -1, "", 4, "FLIP's map over the object's pixels"),
    Metric("core_flip", "FLIP in core", -1, "", 4, "FLIP's map over the object's core"),
    Metric("rim_flip", "FLIP on rim", -1, "", 4, "FLIP's map over the object's rim"),
    Metric("lpips", "LPIPS", -1, "", 4, "learned perceptual distance, by the user's weights"),
    Metric("cc_psnr", "PSNR colour-corrected", +1, "dB", 2, "PSNR after an affine fit of colour"),
    Metric(
        "mask_cc_psnr",
        "PSNR in mask colour-corrected",
        +1,
        "dB",
        2,
        "PSNR over the object's pixels after an affine fit of colour over them",
    ),
    Metric("haze", "Haze", -1, "", 3, "opacity of what hangs in the air before the camera"),
    Metric("mask_haze", "Haze in mask", -1, "", 3, "the same over the object's pixels"),
    Metric("detail_psnr", "PSNR small parts", +1, "dB", 2, "PSNR over screws, wires and print"),
    Metric("detail_ssim", "SSIM small parts", +1, "", 3, "SSIM's map averaged over those pixels"),
    Metric("detail_flip", "FLIP small parts", -1, "", 4, "FLIP's map averaged over those pixels"),
)
_TRAINING = tuple(
    replace(
        metric,
        id=f"train_{metric.id}",
        label=f"Training {metric.label}",
        description=f"{metric.description}; training views, the paper's protocol",
    )
    for metric in _IMAGE
    if metric.id not in HELD_OUT_ONLY
)
_RUN = (
    Metric("fps", "FPS", +1, "1/s", 1, "forward renderings of test views a second, no files"),
    Metric("time", "Time", -1, "s", 1, "wall seconds of the training loop alone"),
    Metric("time_cpu", "CPU time", -1, "s", 1, "CPU seconds of the training loop, all threads"),
    Metric("size_mb", "Size(MB)", -1, "MB", 2, "bytes of the PLY divided by 10⁶"),
    Metric("splats", "Splats", 0, "", 0, "number of Gaussians"),
    Metric("calibration", "Calibration", 0, "s", 4, "seconds of the fixed workload, same process"),
    Metric("fps_calibrated", "FPS calibrated", +1, "", 3, "frames in one calibration workload"),
    Metric("fps_noise", "FPS noise", 0, "", 4, "relative standard error of the calibrated rate"),
    Metric("test_views", "Test views", 0, "", 0, "held-out views that were scored"),
    Metric("missing_views", "Missing", -1, "", 0, "held-out views without a camera: failures"),
)
METRICS: dict[str, Metric] = {m.id: m for m in (*_IMAGE, *_TRAINING, *_RUN)}
IMAGE_METRICS = tuple(m.id for m in _IMAGE)
