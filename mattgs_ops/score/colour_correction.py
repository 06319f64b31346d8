"""Colour correction: a rendering with the exposure of the photo that it is compared with.

A photo's exposure and white balance are no part of the object. Where training gave each photo an
exposure of its own, a held-out photo has none, and plain PSNR counts its brightness as an error.
The correction is the affine change of colour, ``A c + b`` with A [3, 3] and b [3], that takes the
rendering to the truth with least squared difference, clamped to [0, 1] afterwards. It has seen the
truth through those twelve numbers, so its scores stand beside the plain ones, never in their place.
"""

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.floating]
Array = NDArray[np.float64]


def colour_corrected(
    image: Image, truth: Image, mask: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Return the rendering [H, W, 3] with its colours fitted to the truth, in [0, 1].

    The fit is over the pixels of ``mask`` [H, W] where one is given, over all otherwise.
    """
    rendered = np.asarray(image, dtype=np.float64)
    wanted = np.asarray(truth, dtype=np.float64)
    chosen, target = (rendered, wanted) if mask is None else (rendered[mask], wanted[mask])
    chosen, target = _with_one(chosen.reshape(-1, 3)), target.reshape(-1, 3)
    # normal equations: 4 × 4, whatever the image's size; lstsq copes where colours are all alike
    solution = np.linalg.lstsq(chosen.T @ chosen, chosen.T @ target, rcond=None)[0]
    fitted: Array = np.clip(_with_one(rendered.reshape(-1, 3)) @ solution, 0, 1)
    return fitted.reshape(rendered.shape)


def _with_one(colours: Array) -> Array:
    return np.concatenate([colours, np.ones((len(colours), 1))], axis=1)
