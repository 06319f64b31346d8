"""The image metrics; ``metric_table.py`` lists all that is measured.

Images are [H, W, 3] float32 or float64 in [0, 1], sRGB as stored, and multiples of 1/255: scores
are of what a file can hold. Masks are [H, W] bool. PSNR, SSIM and L1 of a run are means over its
views of the values per view.

SSIM is the Gaussian form of Wang et al. 2004 (11 × 11 window, σ 1.5, population covariance), the
same as scikit-image's to rounding: the mean leaves out the outermost 5 pixels.

The object is scored three times, over the pixels of its mask alone (a background that was
multiplied away cannot lower an error there): whole (``mask_``), its core (``core_``: the mask
eroded by the reach of SSIM's window, so that no window looks at what lies outside) and its rim
(``rim_``: the rest of the mask, silhouettes and what is thinner than the window). SSIM's map is
averaged over those very pixels, and so is FLIP's; of whole and rim SSIM's windows see what stands
beside the object.
Small structures (screws, wires, print) are the pixels that a renderer's id map names and the mask
holds.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.score.colour_correction import colour_corrected
from mattgs_ops.score.lpips import Lpips
from mattgs_ops.score.metric_table import PARTS
from mattgs_ops.score.perceptual import flip_map
from mattgs_ops.splat.ssim import SSIM_WINDOW

Image = NDArray[np.floating]
MaskArray = NDArray[np.bool_]

SSIM_SIGMA = 1.5
SSIM_C1, SSIM_C2 = 0.01**2, 0.03**2  # keep its quotients finite, for values in [0, 1]
SSIM_REACH = SSIM_WINDOW // 2  # pixels; also the erosion of masks
PSNR_CEILING = 100.0  # dB; identical 8-bit images would be infinitely good


def psnr(image: Image, truth: Image) -> float:
    """Return the peak signal-to-noise ratio in dB, at most ``PSNR_CEILING``."""
    difference = _difference(image, truth)
    return _decibels(float(np.mean(difference**2)))


def l1(image: Image, truth: Image) -> float:
    """Return the mean absolute difference over all pixels and channels."""
    return float(np.mean(np.abs(_difference(image, truth))))


def weighted_l1(image: Image, truth: Image, weights: NDArray[np.floating]) -> float:
    """Return eq. 15: the mean over all pixels of weight [H, W] × absolute difference."""
    return float(np.mean(weights[:, :, None] * np.abs(_difference(image, truth))))


def ssim(image: Image, truth: Image) -> float:
    """Return the structural similarity, the mean over channels and inner pixels."""
    inner = _inner(ssim_map(image, truth))
    return float(inner.mean())


def ssim_map(image: Image, truth: Image) -> NDArray[np.float64]:
    """Return SSIM at each pixel, [H, W], the mean over channels.

    Raises :class:`InputError` for images smaller than the window.
    """
    _difference(image, truth)
    if min(truth.shape[:2]) < SSIM_WINDOW:
        raise InputError(
            f"SSIM needs images of {SSIM_WINDOW} x {SSIM_WINDOW} pixels at least, found "
            f"{truth.shape[1]} x {truth.shape[0]}: use a higher resolution"
        )
    x, y = (np.asarray(one, dtype=np.float64) for one in (image, truth))
    mean_x, mean_y = _blurred(x), _blurred(y)
    square_x, square_y, product = mean_x * mean_x, mean_y * mean_y, mean_x * mean_y
    spread = _blurred(x * x + y * y) - square_x - square_y  # both variances
    together = _blurred(x * y) - product
    values = (2 * product + SSIM_C1) * (2 * together + SSIM_C2)
    values /= (square_x + square_y + SSIM_C1) * (spread + SSIM_C2)
    mean: NDArray[np.float64] = values.mean(axis=2)
    return mean


def _blurred(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return SSIM's window about each pixel, averaged; images go on mirrored outside the frame."""
    row = cv2.getGaussianKernel(SSIM_WINDOW, SSIM_SIGMA, cv2.CV_64F)
    return np.asarray(cv2.sepFilter2D(image, -1, row, row, borderType=cv2.BORDER_REFLECT))


def mask_psnr(image: Image, truth: Image, mask: MaskArray) -> float | None:
    """Return PSNR over the mask's pixels; None for an empty mask."""
    difference = _difference(image, truth)[mask]
    return _decibels(float(np.mean(difference**2))) if difference.size else None


def mask_l1(image: Image, truth: Image, mask: MaskArray) -> float | None:
    """Return the mean absolute difference over the mask's pixels; None for an empty mask."""
    difference = _difference(image, truth)[mask]
    return float(np.mean(np.abs(difference))) if difference.size else None


def object_parts(mask: MaskArray) -> dict[str, MaskArray]:
    """Return the pixels of the whole object, of its core and of its rim, by their names."""
    core = mask_core(mask)
    return {"mask": mask, "core": core, "rim": mask & ~core}


def mask_core(mask: MaskArray) -> MaskArray:
    """Erode a mask by SSIM's reach (a square window); outside the frame counts as background."""
    window = np.ones((SSIM_WINDOW, SSIM_WINDOW), np.uint8)
    border = cv2.BORDER_CONSTANT
    eroded = cv2.erode(mask.astype(np.uint8), window, borderType=border, borderValue=0)
    core: MaskArray = eroded.astype(np.bool_)
    return core


def score_view(
    image: Image,
    truth: Image,
    mask: MaskArray | None,
    *,
    attention: NDArray[np.floating],
    ssim_lambda: float,
    details: MaskArray | None = None,
    haze: NDArray[np.floating] | None = None,
    lpips: Lpips | None = None,
) -> dict[str, float | None]:
    """Return all image metrics of one view by id; None where a metric does not apply.

    ``mask`` None: the view has no mask. ``attention`` [H, W] is A of eqs. 9–14 on ``truth``.
    ``details`` are the small structures' pixels, None where nobody knows them; ``haze`` [H, W] is
    :func:`mattgs_ops.score.haze.haze_map`'s, None where it is not known; ``lpips`` None: the
    user named no weights.
    """
    similarity, apparent = ssim_map(image, truth), flip_map(image, truth)
    full_ssim, plain = float(_inner(similarity).mean()), l1(image, truth)
    weighted = weighted_l1(image, truth, attention)
    dissimilar = ssim_lambda * (1 - full_ssim)
    scores: dict[str, float | None] = {
        "ssim": full_ssim,
        "psnr": psnr(image, truth),
        "l1": plain,
        "loss": (1 - ssim_lambda) * plain + dissimilar,
        "paper_l1": weighted,
        "paper_loss": (1 - ssim_lambda) * weighted + dissimilar,
        **{f"{p}_{name}": None for p in PARTS for name in ("psnr", "ssim", "l1", "flip")},
        "flip": float(apparent.mean()),
        "cc_psnr": psnr(colour_corrected(image, truth), truth),
        "mask_cc_psnr": None,
        "lpips": None if lpips is None else lpips.distance(image, truth),
        "haze": None if haze is None else float(haze.mean()),
        "mask_haze": None if haze is None or mask is None else _mean(haze[mask]),
        "detail_psnr": None,
        "detail_ssim": None,
        "detail_flip": None,
    }
    if mask is not None:
        for part, pixels in object_parts(mask).items():
            scores[f"{part}_psnr"] = mask_psnr(image, truth, pixels)
            scores[f"{part}_ssim"] = _mean(similarity[pixels])
            scores[f"{part}_l1"] = mask_l1(image, truth, pixels)
            scores[f"{part}_flip"] = _mean(apparent[pixels])
        scores["mask_cc_psnr"] = mask_psnr(colour_corrected(image, truth, mask), truth, mask)
    if details is not None:
        small = details if mask is None else details & mask
        scores["detail_psnr"] = mask_psnr(image, truth, small)
        scores["detail_ssim"] = _mean(similarity[small])
        scores["detail_flip"] = _mean(apparent[small])
    return scores


def _mean(values: NDArray[np.floating]) -> float | None:
    return float(values.mean()) if values.size else None


def _inner(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values[SSIM_REACH:-SSIM_REACH, SSIM_REACH:-SSIM_REACH]


def _decibels(mean_square: float) -> float:
    if mean_square <= 10 ** (-PSNR_CEILING / 10):
        return PSNR_CEILING
    return float(-10 * np.log10(mean_square))


def _difference(image: Image, truth: Image) -> NDArray[np.float64]:
    if image.shape != truth.shape or image.ndim != 3:
        raise InputError(f"expected two images of one size, found {image.shape} and {truth.shape}")
    return np.asarray(image, dtype=np.float64) - np.asarray(truth, dtype=np.float64)
