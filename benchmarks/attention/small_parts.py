"""How much of the object small parts are: their share of its pixels in the views with part ids.

    python benchmarks/attention/small_parts.py [CAPTURE…] [--resolution 640]

CAPTURE is a folder of `mattgs captures render`; by default the bundled captures. Pixels are those
that held-out views are scored on: a pixel counts as a small part where a quarter of it is one.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from mattgs_ops.capture.masks import read_map
from mattgs_ops.capture.source import BUNDLED_FOLDER
from mattgs_ops.config import BUNDLED
from mattgs_ops.score.truth import small_structures
from mattgs_ops.splat.photos import size_at

HALF_COVERED = 128  # of 255: from here on a mask's pixel counts as object


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures", type=Path, nargs="*")
    parser.add_argument("--resolution", type=int, default=640, help="of the longest side, pixels")
    given = parser.parse_args()
    print("| capture | views | small parts |\n|---|---|---|")
    for folder in given.captures or [BUNDLED_FOLDER / name for name in BUNDLED]:
        views = sorted((folder / "ids").rglob("*.png"))
        parts, whole = np.sum([counts(folder, view, given.resolution) for view in views], axis=0)
        print(f"| {folder.name} | {len(views)} | {100 * parts / whole:.1f} % |")


def counts(folder: Path, ids: Path, resolution: int) -> tuple[int, int]:
    """Return the pixels of small parts on the object, and all of the object's, of one view."""
    mask = read_map(folder / "masks" / ids.relative_to(folder / "ids"))
    size = size_at(mask.shape[1], mask.shape[0], resolution)
    thing = cv2.resize(mask, size, interpolation=cv2.INTER_AREA) >= HALF_COVERED
    small = small_structures(ids, thing.shape) > 0
    return int((small & thing).sum()), int(thing.sum())


if __name__ == "__main__":
    main()
