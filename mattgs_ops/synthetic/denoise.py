"""Removing the path tracer's noise: Intel Open Image Denoise.

The library (https://www.openimagedenoise.org) gets the surfaces' colours and orientations beside
the traced light, so that print and edges stay.
"""

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import StageError

Floats = NDArray[np.float32]


def denoise(light: Floats, albedo: Floats, normal: Floats) -> Floats:
    """Return linear ``light`` [H, W, 3] without noise; ``albedo`` and ``normal`` are [H, W, 3].

    Both are taken as free of noise (``clean_aux``): of a pinhole and diffuse surfaces they have
    none but the sampling of edges, which is the photo's own. Raises :class:`StageError` where the
    library is not installed.
    """
    try:
        import pyoidn
    except ImportError as error:
        raise StageError(
            "rendering captures needs Open Image Denoise: install the `captures` extra "
            "(pip install 'mattgs-bench[captures]')"
        ) from error
    layers = (light, np.clip(albedo, 0, 1), normal)
    colour, albedo, normal = (np.ascontiguousarray(layer, dtype=np.float32) for layer in layers)
    clean = pyoidn.denoise(colour, albedo=albedo, normal=normal, hdr=True, clean_aux=True)
    return np.asarray(clean, dtype=np.float32)
