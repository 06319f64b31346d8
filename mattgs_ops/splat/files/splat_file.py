"""The ``.splat`` format: 32 bytes a splat, no header, as antimatter15/splat's viewer reads it.

Per splat, little endian: position 3 × float32, scale 3 × float32 (not its logarithm), colour and
opacity 4 × uint8, rotation w x y z as 4 × uint8 with 128 for zero. The largest and most opaque
splats come first, so that a viewer may draw while it loads. Colour keeps its constant term only.

Source of the layout: github.com/antimatter15/splat, ``convert.py``.
"""

from pathlib import Path

import numpy as np

from mattgs_ops.splat.files.activated import activated, levels, write_whole
from mattgs_ops.splat.gaussians import Splats

RECORD = np.dtype(
    [("position", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)]
)


def write_splat(splats: Splats, path: Path) -> None:
    """Write ``splats`` to ``path``."""
    found = activated(splats)
    size = np.exp(found.log_scales.sum(axis=1)) * found.alpha
    found = found.take(np.argsort(-size, kind="stable"))
    table = np.zeros(len(found.means), dtype=RECORD)
    table["position"] = found.means
    table["scale"] = np.exp(found.log_scales)
    table["colour"][:, :3] = levels(found.colour * 255, 255)
    table["colour"][:, 3] = levels(found.alpha * 255, 255)
    table["rotation"] = levels(found.quaternions * 128 + 128, 255)
    write_whole(path, table.tobytes())
