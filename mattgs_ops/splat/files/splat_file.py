"""The ``.splat`` format: 32 bytes a splat, no header, as antimatter15/splat's viewer reads it.

Per splat, little endian: position 3 × float32, scale 3 × float32 (not its logarithm), colour and
opacity 4 × uint8, rotation w x y z as 4 × uint8 with 128 for zero. The largest and most opaque
splats come first, so that a viewer may draw while it loads. Colour keeps its constant term only.

Source of the layout: github.com/antimatter15/splat, ``convert.py``.
"""

from pathlib import Path

import numpy as np

from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.activated import (
    activated,
    levels,
    splats_of,
)
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_CONSTANT
from mattgs_ops.whole_file import written_whole

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
    with written_whole(path) as partial:
        partial.write_bytes(table.tobytes())


def read_splat(path: Path) -> Splats:
    """Read splats; what the format does not hold, colour's dependence on direction, is zero.

    Raises :class:`InputError` naming the file when it is no such file, or holds NaN.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: expected a .splat file: {error}") from error
    if len(data) % RECORD.itemsize:
        raise InputError(
            f"{path}: expected {RECORD.itemsize} bytes a splat, found {len(data)} bytes"
        )
    table = np.frombuffer(data, dtype=RECORD)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_scales = np.log(table["scale"].astype(np.float64))
    return splats_of(
        path,
        means=table["position"].astype(np.float64),
        log_scales=log_scales,
        quaternions=table["rotation"].astype(np.float64) - 128,
        alpha=table["colour"][:, 3] / 255,
        sh_dc=(table["colour"][:, :3] / 255 - 0.5) / SH_CONSTANT,
    )
