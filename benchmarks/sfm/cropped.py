"""Photos that were cropped or scaled: how far their cameras come out from where they were.

    python benchmarks/sfm/cropped.py rover fox=../photos/fox

Of each capture, which needs known cameras, every third photo is changed: cropped by up to 18 % on
each side, or made smaller by up to 40 %, anew for each (seeded). Prints one Markdown row per
capture and change, with none first.
"""

import argparse
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.sfm.modes import pose_cells, prepared
from mattgs_ops import sfm
from mattgs_ops.capture.mask_files import binary
from mattgs_ops.capture.photos import read_rgb, write_png
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.config import SfmConfig

EVERY, FIRST = 3, 1
MOST_CUT, MOST_SCALED = 0.18, 0.4
HEADER = (
    "capture", "changed", "photos", "registered", "taken for cropped", "rotation ° mean / max",
    "position mean / max",
)  # fmt: skip
Change = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def main() -> None:
    """Parse arguments, change and reconstruct each capture, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures", nargs="+", help="bundled names, or NAME=FOLDER with cameras")
    print("| " + " | ".join(HEADER) + " |")
    print("|" + "---|" * len(HEADER))
    changes: dict[str, Change | None] = {"none": None, "cropped": cut, "scaled": scaled}
    for text in parser.parse_args().captures:
        with tempfile.TemporaryDirectory() as scratch:
            capture, masks = prepared(text, Path(scratch))
            for name, change in changes.items():
                print(row(capture, masks, name, change, Path(scratch) / name), flush=True)


def cut(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Cut a picture's sides off."""
    height, width = picture.shape[:2]
    left, right, top, bottom = rng.uniform(0, MOST_CUT, 4) * [width, width, height, height]
    return picture[int(top) : height - int(bottom), int(left) : width - int(right)]


def scaled(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Make a picture smaller."""
    scale = rng.uniform(1 - MOST_SCALED, 1)
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def row(
    base: PreparedCapture, its_masks: Path, name: str, change: Change | None, folder: Path
) -> str:
    """Reconstruct a capture with some photos changed, in a folder of its own; returns its row."""
    shutil.copytree(base.folder, folder / "capture")
    masks = shutil.copytree(its_masks, folder / "of-object")
    capture = PreparedCapture.load(folder / "capture")
    changed = [] if change is None else capture.views[FIRST::EVERY]
    views = {view.name: view for view in capture.views}
    for number, view in enumerate(changed):
        assert change is not None
        views[view.name] = changed_view(view, masks, change, number)
    # known cameras are compared with only: what is given would be kept
    capture = replace(capture, views=tuple(views.values()), cameras_are="truth")
    found = sfm.reconstruct(capture, masks, SfmConfig(poses="estimate"), folder / "out", threads=2)
    cells = [
        capture.name,
        name,
        f"{len(changed)} of {len(views)}",
        str(found.extra["registered"]),
        str(len(found.extra["cropped"])),
        *pose_cells(found.extra["pose_error"]),
    ]
    return "| " + " | ".join(cells) + " |"


def changed_view(view: View, masks: Path, change: Change, number: int) -> View:
    """Change a view's photo and mask alike."""
    mask = masks / f"{view.name}.png"
    grey = change(read_rgb(mask), np.random.default_rng(number))[..., 0]
    write_png(mask, binary(grey, str(mask)))
    picture = change(read_rgb(view.photo), np.random.default_rng(number))
    write_png(view.photo, np.ascontiguousarray(picture))
    height, width = picture.shape[:2]
    return replace(view, width=width, height=height)


if __name__ == "__main__":
    main()
