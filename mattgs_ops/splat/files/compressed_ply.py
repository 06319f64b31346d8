"""PlayCanvas' compressed PLY: chunks of 256 splats, each number relative to its chunk's range.

Three elements: ``chunk`` with the least and largest position, logarithm of scale and colour as
floats; ``vertex`` with four uint32: position 11-10-11 bits, rotation 2-10-10-10 (which of w x y z
is largest, then the others times √½), scale 11-10-11, colour and opacity 8-8-8-8, always the
first number in the highest bits; ``sh`` with 45 uint8, channel-major, covering −4 … 4. Splats are
in Morton order, so that those of a chunk lie close together. Logarithms of scales outside ±20 are
clipped.

Source of the layout: github.com/playcanvas/splat-transform, ``compressed-chunk.ts`` and
``write-compressed-ply.ts``.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.splat.files.activated import Activated, Floats, activated, levels
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_REST
from mattgs_ops.whole_file import written_whole

CHUNK = 256  # splats
SCALE_LIMIT = 20.0
SH_SPAN = 8.0  # from −4 to 4
NARROW = 1e-5  # a range below this is a single value
MORTON_BITS = 10
CHUNK_PROPERTIES = tuple(
    f"{end}_{name}"
    for group in (("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b"))
    for end in ("min", "max")
    for name in group
)
VERTEX_PROPERTIES = ("packed_position", "packed_rotation", "packed_scale", "packed_color")

Words = NDArray[np.uint32]


def write_compressed_ply(splats: Splats, path: Path) -> None:
    """Write ``splats`` to ``path``."""
    found = activated(splats)
    found = found.take(morton_order(found.means))
    count = len(found.means)
    scales = np.clip(found.log_scales, -SCALE_LIMIT, SCALE_LIMIT)
    ranges, shares = zip(*map(_in_chunks, (found.means, scales, found.colour)), strict=True)
    words = np.stack(
        [
            _packed(shares[0], (11, 10, 11)),
            _rotations(found.quaternions),
            _packed(shares[1], (11, 10, 11)),
            _packed(np.column_stack([shares[2], found.alpha]), (8, 8, 8, 8)),
        ],
        axis=1,
    )
    parts = (
        _header(count, len(ranges[0])),
        np.concatenate(ranges, axis=1).astype("<f4").tobytes(),
        words.astype("<u4").tobytes(),
        _harmonics(found).tobytes(),
    )
    with written_whole(path) as partial:
        partial.write_bytes(b"".join(parts))


def morton_order(means: Floats) -> NDArray[np.int64]:
    """Return the order along a Z-curve through the box of the points [N, 3]."""
    low, high = means.min(axis=0), means.max(axis=0)
    cells = ((means - low) / np.maximum(high - low, 1e-30) * (2**MORTON_BITS - 1)).astype(np.int64)
    codes = np.zeros(len(means), dtype=np.int64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            codes |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(codes, kind="stable")


def _header(count: int, chunks: int) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", "comment MATT-GS Bench"]
    lines += [f"element chunk {chunks}", *(f"property float {name}" for name in CHUNK_PROPERTIES)]
    lines += [f"element vertex {count}", *(f"property uint {name}" for name in VERTEX_PROPERTIES)]
    lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(3 * SH_REST))]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def _in_chunks(values: Floats) -> tuple[Floats, Floats]:
    """Return per chunk least and largest [C, 6], and the values' shares of that range [N, 3]."""
    starts = np.arange(0, len(values), CHUNK)
    # a reader computes with the rounded ends, so the shares are of these
    low = np.minimum.reduceat(values, starts).astype("<f4").astype(np.float64)
    high = np.maximum.reduceat(values, starts).astype("<f4").astype(np.float64)
    chunk = np.arange(len(values)) // CHUNK
    span = (high - low)[chunk]
    shares = np.where(span < NARROW, 0.0, (values - low[chunk]) / np.maximum(span, NARROW))
    return np.concatenate([low, high], axis=1), np.clip(shares, 0, 1)


def _packed(shares: Floats, bits: tuple[int, ...]) -> Words:
    """Pack columns of [0, 1] into words, the first in the highest bits."""
    words = np.zeros(len(shares), dtype=np.uint32)
    for column, width in zip(shares.T, bits, strict=True):
        top = 2**width - 1
        words = words << np.uint32(width) | levels(column * top, top).astype(np.uint32)
    return words


def _rotations(quaternions: Floats) -> Words:
    """Drop the largest component, made positive; the others lie within ±√½."""
    largest = np.abs(quaternions).argmax(axis=1)
    rows = np.arange(len(quaternions))
    signs = np.where(quaternions[rows, largest] < 0, -1.0, 1.0)
    upright = quaternions * signs[:, None]
    others = np.array([[k for k in range(4) if k != i] for i in range(4)])[largest]
    shares = upright[rows[:, None], others] * np.sqrt(0.5) + 0.5
    words: Words = largest.astype(np.uint32) << np.uint32(30) | _packed(shares, (10, 10, 10))
    return words


def _harmonics(found: Activated) -> NDArray[np.uint8]:
    channel_major = found.sh_rest.transpose(0, 2, 1).reshape(len(found.means), 3 * SH_REST)
    levels = np.trunc((channel_major / SH_SPAN + 0.5) * 256)
    return np.clip(levels, 0, 255).astype(np.uint8)
