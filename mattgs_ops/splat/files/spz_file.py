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
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.activated import (
    Activated,
    Floats,
    activated,
    levels,
    splats_of,
)
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_REST
from mattgs_ops.whole_file import written_whole

MAGIC, VERSION, DEGREE = 0x5053474E, 3, 3
HEADER = struct.Struct("<IIIBBBB")
MOST_FRACTION = 16  # bits behind the point; a scene of two kilometres still has twelve
LIMIT = 2**23 - 1  # of a signed 24-bit number
COLOUR_SCALE = 0.15
TURN_STEPS = 511
DEGREE_1_BITS, REST_BITS = 5, 4
WORD = 4
READ_ROTATIONS = {2: 3, 3: WORD}  # version → bytes of a rotation
# Signs of the 15 harmonics of degree 1 to 3 when y and z change theirs
MIRROR = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], dtype=np.float64)


def write_spz(splats: Splats, path: Path) -> None:
    """Write ``splats`` to ``path``; raises :class:`InputError` when they lie too far away."""
    found = activated(splats)
    bits = _fraction_bits(float(np.abs(found.means).max()), path)
    header = HEADER.pack(MAGIC, VERSION, len(found.means), DEGREE, bits, 0, 0)
    parts = (header, _positions(found.means, bits), *_bytes(found))
    # without a date, so that the same splats are the same file
    packed = gzip.compress(b"".join(parts), compresslevel=6, mtime=0)
    with written_whole(path) as partial:
        partial.write_bytes(packed)


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


def read_spz(path: Path) -> Splats:
    """Read splats of version 2 or 3, in our axes; harmonics that the file lacks are zero.

    Raises :class:`InputError` naming the file when it is no such file, or cut short.
    """
    try:
        data = gzip.decompress(path.read_bytes())
        magic, version, count, degree, bits, _, _ = HEADER.unpack_from(data)
    except (OSError, EOFError, zlib.error, struct.error) as error:
        raise InputError(f"{path}: expected a .spz file: {error}") from error
    if magic != MAGIC or version not in READ_ROTATIONS or degree > DEGREE:
        raise InputError(
            f"{path}: expected .spz of version 2 or 3, found magic {magic:#x}, version {version}, "
            f"harmonics of degree {degree}"
        )
    kept = (degree + 1) ** 2 - 1
    rotation_bytes = READ_ROTATIONS[version]
    widths = (9, 1, 3, 3, rotation_bytes, 3 * kept)
    ends = count * np.cumsum(widths)
    if len(data) < HEADER.size + ends[-1]:
        expected = HEADER.size + ends[-1]
        raise InputError(f"{path}: cut short: expected {expected} bytes, found {len(data)}")
    raw = np.frombuffer(data, np.uint8, int(ends[-1]), HEADER.size)
    parts = np.split(raw, ends[:-1])
    place, alpha, colour, scale, turn, rest = (
        part.reshape(count, width) for part, width in zip(parts, widths, strict=True)
    )
    low = np.zeros((count * 3, 4), np.uint8)
    low[:, 1:] = place.reshape(-1, 3)  # in the upper bytes, so that the sign is the number's
    whole = (low.view("<i4")[:, 0] >> 8).reshape(count, 3)
    read_turn = _turn_words if rotation_bytes == WORD else _turn_bytes
    quaternions = read_turn(np.ascontiguousarray(turn))
    harmonics = np.zeros((count, SH_REST, 3))
    harmonics[:, :kept] = (rest.reshape(count, kept, 3) - 128.0) / 128
    return splats_of(
        path,
        means=whole / 2.0**bits * [1.0, -1.0, -1.0],
        log_scales=scale / 16 - 10.0,
        quaternions=quaternions[:, [3, 0, 1, 2]] * [1.0, 1.0, -1.0, -1.0],
        alpha=alpha[:, 0] / 255,
        sh_dc=(colour / 255 - 0.5) / COLOUR_SCALE,
        sh_rest=harmonics * MIRROR[:, None],
    )


def _turn_words(stored: NDArray[np.uint8]) -> Floats:
    """Return quaternions [N, 4] xyzw of version 3's words [N, 4]; the largest is what is left."""
    words = stored.view("<u4")[:, 0].astype(np.int64)
    largest = words >> 30
    out = np.zeros((len(words), 4))
    for place in (3, 2, 1, 0):
        there = largest != place
        steps, negative = words & TURN_STEPS, (words >> 9) & 1
        value = np.sqrt(0.5) * steps / TURN_STEPS * np.where(negative == 1, -1.0, 1.0)
        out[there, place] = value[there]
        words = np.where(there, words >> 10, words)
    rows = np.arange(len(out))
    out[rows, largest] = np.sqrt(np.maximum(0, 1 - (out**2).sum(axis=1)))
    return out


def _turn_bytes(stored: NDArray[np.uint8]) -> Floats:
    """Return quaternions [N, 4] xyzw of version 2's bytes [N, 3]; w is what is left."""
    xyz = stored / 127.5 - 1.0
    w = np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1)))
    return np.concatenate([xyz, w[:, None]], axis=1)
