"""Boxes whose opposite sides look alike: where cameras come out, and whether that is told.

    python benchmarks/sfm/look_alikes.py --prints 8000 4000 --seeds 1 2 3

Each box is photographed 24 times around, on a table with a print of so many blobs. Mode
``original`` follows all pairs; the default mode tests poses by what pairs share beside the box.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from mattgs_ops import sfm
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm import look_alikes
from tests.mattgs_ops import conftest as box

VIEWS = 24
FORM = "| {} | {} | {} | {} | {} | {} | {} |"


def main() -> None:
    """Print one line a box and mode."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prints", type=int, nargs="+", default=[8000, 4000])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    options = parser.parse_args()
    print(FORM.format("blobs", "seed", "mode", "views", "error °", "contradicted", "in doubt"))
    print(FORM.format(*["---"] * 7))
    for blobs in options.prints:
        for seed in options.seeds:
            for mode in ("original", "shared"):
                print(FORM.format(blobs, seed, mode, *reconstructed(blobs, seed, mode)), flush=True)


def reconstructed(blobs: int, seed: int, mode: str) -> tuple[object, ...]:
    """Return views, largest error of a rotation, sure pairs contradicted, and whether in doubt."""
    cameras = box.orbit(VIEWS, 2 * np.pi / VIEWS)
    with tempfile.TemporaryDirectory() as folder:
        photos = Path(folder) / "in"
        capture = box.photographed_by(photos, box.with_equal_sides(seed, blobs), cameras)
        config = SfmConfig.model_validate({"mode": mode})
        scene = sfm.reconstruct(capture, photos / "masks", config, Path(folder) / "out")
    told = scene.extra["beside_object"]
    contradicted = f"{look_alikes.unexplained(told)} of {told['pairs']}" if told else "–"
    error = f"{scene.extra['pose_error']['rotation_deg_max']:.1f}"
    return scene.extra["registered"], error, contradicted, scene.extra["poses_in_doubt"]


if __name__ == "__main__":
    main()
