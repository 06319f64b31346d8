"""The photometric loss of 3DGS and its gradient, by the compiled engine.

``loss = (1 - lambda) * mean(w * |y - y_hat|) + lambda * (1 - mean(v * SSIM))`` over all values of
an image [H, W, 3] in [0, 1]; v is 1, or w where that is asked for. SSIM (Wang et al. 2004) per
channel with an 11×11 Gaussian window of sigma 1.5 and zeros outside the image, as 3DGS trains;
evaluation uses another border.
"""

import math
from dataclasses import dataclass

from torch import Tensor

from mattgs_ops.errors import InputError
from mattgs_ops.splat import _engine
from mattgs_ops.splat.memory import Memory, Unshared
from mattgs_ops.splat.rasterize import MAX_THREADS, checked_array

SSIM_WINDOW = 11  # pixels a side (Wang et al. 2004); evaluation scores images from that size on


@dataclass(frozen=True)
class PhotometricLoss:
    """The loss, its terms, and dL/d image."""

    loss: float
    l1: float  # mean(w * |y - y_hat|)
    ssim: float  # mean SSIM, whatever the weight
    grad: Tensor  # [H, W, 3]
    plain_l1: float  # mean(|y - y_hat|), whatever the weight


def photometric_loss(
    image: Tensor,
    target: Tensor,
    *,
    ssim_lambda: float = 0.2,
    weight: Tensor | None = None,
    weight_ssim: bool = False,
    threads: int = 1,
    memory: Memory | None = None,
) -> PhotometricLoss:
    """Compare ``image`` with ``target``, both [H, W, 3] float32; ``weight`` [H, W] or none.

    The weight enters the L1 term alone, or both with ``weight_ssim``. The gradient of ``|d|`` at 0
    is 0. With a ``memory`` the gradient lies there, until the next call with the same one. Raises
    :class:`InputError` for wrong shapes or types, or a ``ssim_lambda`` outside [0, 1].
    """
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise InputError(f"image: expected shape (H, W, 3), found {tuple(image.shape)}")
    if not 0 <= ssim_lambda <= 1 or math.isnan(ssim_lambda):
        raise InputError(f"ssim_lambda: expected 0 to 1, found {ssim_lambda}")
    if not 1 <= threads <= MAX_THREADS:
        raise InputError(f"threads: expected 1 to {MAX_THREADS}, found {threads}")
    height, width, _ = image.shape
    memory = Unshared() if memory is None else memory
    grad = memory.take("d image", height, width, 3)
    weighted, plain, ssim, weighted_ssim = _engine.photometric_loss(
        checked_array("image", image, (height, width, 3)),
        checked_array("target", target, (height, width, 3)),
        checked_array("weight", weight, (height, width)),
        weight_ssim,
        ssim_lambda,
        threads,
        grad.numpy(),
    )
    loss = (1 - ssim_lambda) * weighted + ssim_lambda * (1 - weighted_ssim)
    return PhotometricLoss(loss, weighted, ssim, grad, plain)


def psnr(image: Tensor, target: Tensor) -> float:
    """Return the peak signal-to-noise ratio in dB of two images in [0, 1], at most 100."""
    mse = float((image - target).square().mean())
    return -10 * math.log10(max(mse, 1e-10))
