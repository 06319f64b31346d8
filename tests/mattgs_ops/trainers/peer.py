"""A program that trains splats, as others would write one: it knows nothing of this project.

``peer.py WAY DATA OUTPUT ITERATIONS SEED``: puts a splat on every point that it is given. WAY says
what it does otherwise. ``peer.py --version`` prints its version.
"""

import struct
import sys
import time
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement

SH_CONSTANT = 0.28209479177387814
PLACE_AND_COLOUR = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity")
SHAPE = ("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")
NAMES = (*PLACE_AND_COLOUR, *SHAPE)


def colmap_points(path: Path) -> np.ndarray:
    """Read positions and colours [P, 6] of a ``points3D.bin``."""
    data = path.read_bytes()
    rows, at = [], 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        _, *values, _, track = struct.unpack_from("<Q3d3BdQ", data, at)
        rows.append(values)
        at += struct.calcsize("<Q3d3BdQ") + 8 * track
    return np.array(rows)


def ply_points(path: Path) -> np.ndarray:
    """Read positions and colours [P, 6] of a PLY."""
    vertex = PlyData.read(str(path))["vertex"]
    return np.stack([vertex[name] for name in ("x", "y", "z", "red", "green", "blue")], axis=1)


def points(data: Path) -> np.ndarray:
    if (data / "sparse").is_dir():
        return colmap_points(data / "sparse" / "0" / "points3D.bin")
    return ply_points(next(iter(data.glob("points*.ply"))))


def splats(data: Path) -> np.ndarray:
    """Return rows of numbers [P, 14]: small, nearly opaque splats of the points' colours."""
    found = points(data)
    rows = np.zeros((len(found), len(NAMES)))
    rows[:, :3] = found[:, :3]
    rows[:, 3:6] = (found[:, 3:] / 255 - 0.5) / SH_CONSTANT
    rows[:, 6] = 2.5
    apart = np.linalg.norm(found[:, None, :3] - found[None, :, :3], axis=2)
    near = np.sort(apart, axis=1)[:, 1:4].mean(axis=1)
    rows[:, 7:10] = np.log(np.median(near) * 0.8)  # of one size: far points are no large splats
    rows[:, 10] = 1.0
    return rows


def write(rows: np.ndarray, path: Path) -> None:
    table = np.zeros(len(rows), dtype=[(name, "<f4") for name in NAMES])
    for name, column in zip(NAMES, rows.T, strict=True):
        table[name] = column
    path.parent.mkdir(parents=True, exist_ok=True)
    PlyData([PlyElement.describe(table, "vertex")]).write(str(path))


def spoilt(way: str, rows: np.ndarray) -> np.ndarray:
    if way == "nan":
        rows[3, 1] = np.nan
    elif way == "moves":
        rows[:, :3] = (rows[:, :3] + [0.0, 0.0, 3.0]) / 2
    elif way == "turns":
        rows[:, :3] = rows[:, [1, 0, 2]] * [1, 1, -1]
    elif way == "empties":
        rows = rows[:0]
    return rows


def say(text: str) -> None:
    sys.stdout.write(text)
    sys.stdout.flush()


def main(way: str, data: Path, output: Path, iterations: int) -> None:
    say(f"{len(list(data.rglob('*.png')))} photos, one by one: 1/3\n")
    if way == "fails":
        sys.exit("no CUDA here")
    if way == "sleeps":
        time.sleep(600)
    for step in range(0, iterations + 1, 10):
        say(f"\rStep {step}: 0.1")
    rows = spoilt(way, splats(data))
    if way == "text":
        (output / "splats.ply").write_text("ply\nthis is none\n")
    elif way != "nothing":
        write(rows, output / "point_cloud" / f"iteration_{iterations}" / "point_cloud.ply")
    if way == "two":
        write(rows, output / "last.ply")


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        say("peer 1.2\nand more\n")
    else:
        main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
