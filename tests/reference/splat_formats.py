"""Readers of viewers' formats, one splat after another, written from the formats' descriptions."""

import gzip
import math
import struct
from pathlib import Path
from typing import Any

Splat = dict[str, Any]  # position, log_scale, rotation (wxyz), alpha, colour (of 0.5 + Y00 dc), sh

Y00 = 0.28209479177387814


def read_splat(path: Path) -> list[Splat]:
    data = path.read_bytes()
    assert len(data) % 32 == 0
    out = []
    for start in range(0, len(data), 32):
        numbers = struct.unpack("<6f8B", data[start : start + 32])
        rotation = [(value - 128) / 128 for value in numbers[10:14]]
        out.append(
            {
                "position": list(numbers[:3]),
                "log_scale": [math.log(value) for value in numbers[3:6]],
                "colour": [value / 255 for value in numbers[6:9]],
                "alpha": numbers[9] / 255,
                "rotation": rotation,
            }
        )
    return out


def read_spz(path: Path) -> list[Splat]:
    data = gzip.decompress(path.read_bytes())
    magic, version, count, degree, fraction, _, reserved = struct.unpack("<IIIBBBB", data[:16])
    assert (magic, version, degree, reserved) == (0x5053474E, 3, 3, 0)
    place = 16
    out: list[Splat] = [{} for _ in range(count)]

    def take(size: int) -> bytes:
        nonlocal place
        place += size
        return data[place - size : place]

    for splat in out:
        raw = [take(3) for _ in range(3)]
        x, y, z = (int.from_bytes(part, "little", signed=True) / 2**fraction for part in raw)
        splat["position"] = [x, -y, -z]  # right-up-back → right-down-forward
    for splat in out:
        splat["alpha"] = take(1)[0] / 255
    for splat in out:
        splat["colour"] = [0.5 + Y00 * (value / 255 - 0.5) / 0.15 for value in take(3)]
    for splat in out:
        splat["log_scale"] = [value / 16 - 10 for value in take(3)]
    for splat in out:
        word = int.from_bytes(take(4), "little")
        largest, turn = word >> 30, [0.0] * 4
        for k in (k for k in (3, 2, 1, 0) if k != largest):
            turn[k] = math.sqrt(0.5) * (word & 511) / 511 * (-1 if word >> 9 & 1 else 1)
            word >>= 10
        turn[largest] = math.sqrt(max(0.0, 1 - sum(value * value for value in turn)))
        x, y, z, w = turn
        splat["rotation"] = [w, x, -y, -z]
    for splat in out:
        values = [(value - 128) / 128 for value in take(45)]
        splat["sh"] = [values[3 * k : 3 * k + 3] for k in range(15)]  # still mirrored
    assert place == len(data)
    return out


def read_compressed_ply(path: Path) -> list[Splat]:
    from plyfile import PlyData

    data = PlyData.read(str(path))
    out = []
    for index, vertex in enumerate(data["vertex"].data):
        chunk = data["chunk"].data[index // 256]
        box = [chunk[f"{end}_{axis}"] for end in ("min", "max") for axis in "xyz"]
        sizes = [chunk[f"{end}_scale_{axis}"] for end in ("min", "max") for axis in "xyz"]
        tones = [chunk[f"{end}_{c}"] for end in ("min", "max") for c in "rgb"]
        colour = int(vertex["packed_color"])
        shares = [(colour >> shift & 255) / 255 for shift in (24, 16, 8, 0)]
        out.append(
            {
                "position": _between(box, _eleven(int(vertex["packed_position"]))),
                "log_scale": _between(sizes, _eleven(int(vertex["packed_scale"]))),
                "colour": _between(tones, shares[:3]),
                "alpha": shares[3],
                "rotation": _smallest_three(int(vertex["packed_rotation"])),
            }
        )
    for splat, row in zip(out, data["sh"].data, strict=True):
        splat["sh"] = [
            [(float(row[f"f_rest_{15 * c + k}"]) + 0.5) / 256 * 8 - 4 for c in range(3)]
            for k in range(15)
        ]
    return out


def _eleven(word: int) -> list[float]:
    return [(word >> 21 & 2047) / 2047, (word >> 11 & 1023) / 1023, (word & 2047) / 2047]


def _between(ends: list[float], shares: list[float]) -> list[float]:
    low, high = ends[:3], ends[3:]
    return [float(a + (b - a) * s) for a, b, s in zip(low, high, shares, strict=True)]


def _smallest_three(word: int) -> list[float]:
    largest = word >> 30
    others = [((word >> shift & 1023) / 1023 - 0.5) * math.sqrt(2) for shift in (20, 10, 0)]
    rest = math.sqrt(max(0.0, 1 - sum(value * value for value in others)))
    others.insert(largest, rest)
    return others
