"""How different two images look: FLIP, by NVIDIA's own library.

FLIP (Andersson et al. 2020) models what a viewer sees who flips between rendering and truth: colour
differences, edges and points, each filtered by what an eye resolves at a distance. No weights, no
training. The library's default viewing distance is meant: 67 pixels per degree, a display of
0.7 m with 3,840 pixels across seen from 0.7 m.
"""

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError

Image = NDArray[np.floating]


def flip_map(image: Image, truth: Image) -> NDArray[np.float64]:
    """Return FLIP at each pixel, [H, W] in [0, 1]: 0 looks the same, 1 could not differ more.

    Images are [H, W, 3] in [0, 1], sRGB as stored. Raises :class:`InputError` for images of
    different sizes.
    """
    import flip_evaluator  # loads a library of its own

    if image.shape != truth.shape or image.ndim != 3:
        raise InputError(f"expected two images of one size, found {image.shape} and {truth.shape}")
    seen, wanted = (np.ascontiguousarray(one, dtype=np.float32) for one in (image, truth))
    errors, _, _ = flip_evaluator.evaluate(
        wanted, seen, "LDR", inputsRGB=True, applyMagma=False, computeMeanError=False, parameters={}
    )
    found: NDArray[np.float64] = np.asarray(errors, dtype=np.float64)[..., 0]
    return found
