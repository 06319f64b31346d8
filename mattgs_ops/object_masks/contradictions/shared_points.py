"""Whether a scene's masks contradict each other at points that two photos show.

Structure-from-motion leaves the verified matches of whole photos (``keypoints.npz``), which no mask
has chosen. They tell of masks what silhouettes cannot, as those only bound an object: maps that
hold another part in each photo predict each other's outlines well enough where photos are few.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import mask_name, read_map
from mattgs_ops.capture.scene import Scene
from mattgs_ops.parallel import over_views
from mattgs_ops.segment.contradictions import Contradictions, contradictions
from mattgs_ops.sfm.colmap.job import KEYPOINTS_FILE


def masks_at_shared_points(scene: Scene, *, threads: int = 1) -> tuple[Contradictions, list[str]]:
    """Compare all masks of a scene; returns the names of ``views`` beside their indices."""
    with np.load(scene.folder / KEYPOINTS_FILE) as data:
        arrays = dict(data)
    folder = scene.folder / "masks"
    names = [str(name) for name in arrays["names"]]
    masks = over_views(lambda name: read_map(folder / mask_name(name)), names, threads=threads)
    found = contradictions(_places(arrays), masks)
    return found, [names[index] for index in found.views]


def _places(arrays: dict[str, NDArray[Any]]) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Return each pair's matched points [M, 2, 2] in pixels of both photos."""
    xy = arrays["xy"].astype(np.float64)
    starts = np.cumsum(arrays["counts"]) - arrays["counts"]
    rows = np.split(arrays["matches"].astype(np.int64), np.cumsum(arrays["pair_counts"])[:-1])
    pairs = [(int(first), int(second)) for first, second in arrays["pairs"]]
    return {
        pair: xy[matches + starts[list(pair)]]
        for pair, matches in zip(pairs, rows, strict=False)  # of no pair, one empty part
    }
