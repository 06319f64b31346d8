"""Niantic's ``.spz``, version 3: gzip of a 16-byte header and one array after the other.

Positions 3 × 24-bit fixed point, opacity uint8, colour 3 × uint8 of 0.15 · dc + 0.5, logarithm of
scale 3 × uint8 in sixteenths from −10, rotation as one uint32 (two bits for which of x y z w is
largest, then ten for each of the others, a sign and 511 steps up to √½), spherical harmonics as
uint8 with colour channels innermost; of the harmonics' eight bits, degree 1 uses five and the rest
four, which is what makes gzip effective. Harmonics beyond ±1 are clipped to it, scales outside
e^−10 … e^5.9 likewise.

The format's world is right, up, back; ours is right, down, forward: y and z change their signs,
and what is odd in them with them.

Source of the layout: github.com/nianticlabs/spz, README.md and ``load-spz.cc``.
"""

import gzip
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.activated import Activated, Floats, activated, levels, write_whole
from mattgs_ops.splat.gaussians import SH_REST, Splats

MAGIC, VERSION, DEGREE = 0x5053474E, 3, 3
HEADER = struct.Struct("<IIIBBBB")
MOST_FRACTION = 16  # bits behind the point; a scene of two kilometres still has twelve
LIMIT = 2**23 - 1  # of a signed 24-bit number
COLOUR_SCALE = 0.15
TURN_STEPS = 511
DEGREE_1_BITS, REST_BITS = 5, 4
# Signs of the 15 harmonics of degree 1 to 3 when y and z change theirs
MIRROR = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], dtype=np.float64)


def write_spz(splats: Splats, path: Path) -> None:
    """Write ``splats`` to ``path``; raises :class:`InputError` when they lie too far away."""
    found = activated(splats)
    bits = _fraction_bits(float(np.abs(found.means).max()), path)
    header = HEADER.pack(MAGIC, VERSION, len(found.means), DEGREE, bits, 0, 0)
    parts = (header, _positions(found.means, bits), *_bytes(found))
    # without a date, so that the same splats are the same file
    write_whole(path, gzip.compress(b"".join(parts), compresslevel=6, mtime=0))


def _fraction_bits(farthest: float, path: Path) -> int:
    """Return as many bits behind the point as leave room for the farthest splat."""
    for bits in range(MOST_FRACTION, -1, -1):
        if farthest * 2**bits <= LIMIT - 1:
            return bits
    raise InputError(f"{path}: .spz holds positions below {LIMIT}, found {farthest:g}")


def _positions(means: Floats, bits: int) -> bytes:
    mirrored = means * [1.0, -1.0, -1.0]
    rounded = np.floor(mirrored * 2**bits + 0.5).astype("<i4")
    low = rounded.reshape(-1, 1).view(np.uint8)[:, :3]  # the low three bytes of each
    return bytes(low.tobytes())


def _bytes(found: Activated) -> tuple[bytes, ...]:
    """Return opacities, colours, scales, rotations and harmonics, in the file's order."""
    parts = (
        found.alpha * 255,
        (COLOUR_SCALE * found.sh_dc + 0.5) * 255,
        (found.log_scales + 10) * 16,
    )
    plain = [levels(part, 255).astype(np.uint8).tobytes() for part in parts]
    harmonics = _harmonics(found.sh_rest * MIRROR[:, None])
    return (*plain, _rotations(found.quaternions).tobytes(), harmonics.tobytes())


def _rotations(quaternions: Floats) -> NDArray[np.uint32]:
    mirrored = quaternions[:, [1, 2, 3, 0]] * [1.0, -1.0, -1.0, 1.0]  # xyzw
    largest = np.abs(mirrored).argmax(axis=1)
    rows = np.arange(len(mirrored))
    upright = mirrored * np.where(mirrored[rows, largest] < 0, -1.0, 1.0)[:, None]
    words = largest.astype("<u4")
    for place in range(4):
        steps = levels(np.abs(upright[:, place]) / np.sqrt(0.5) * TURN_STEPS, TURN_STEPS)
        signed = (upright[:, place] < 0).astype("<u4") << np.uint32(9) | steps.astype("<u4")
        words = np.where(place == largest, words, words << np.uint32(10) | signed)
    out: NDArray[np.uint32] = words.astype("<u4")
    return out


def _harmonics(values: Floats) -> NDArray[np.uint8]:
    """Round [N, 15, 3] to the format's steps; the middle of the range, 128, is zero."""
    out = np.empty(values.shape, dtype=np.uint8)
    for part, bits in ((slice(0, 3), DEGREE_1_BITS), (slice(3, SH_REST), REST_BITS)):
        step = 1 << (8 - bits)
        rounded = np.floor(values[:, part] * 128 + 0.5) + 128
        out[:, part] = np.clip(np.floor((rounded + step / 2) / step) * step, 0, 255)
    return out
