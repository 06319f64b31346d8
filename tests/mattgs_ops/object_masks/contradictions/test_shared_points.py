"""Masks of a scene are compared at the verified matches that structure-from-motion left."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.masks import mask_name
from mattgs_ops.capture.scene import Scene
from mattgs_ops.object_masks.contradictions.shared_points import masks_at_shared_points
from mattgs_ops.segment.contradictions import Contradictions
from mattgs_ops.sfm.colmap.job import KEYPOINTS_FILE

NAMES = ("a.jpg", "b.jpg", "c.jpg")
COLUMNS = np.arange(40) + 0.5


def write_key_points(
    folder: Path,
    names: Sequence[str],
    columns: Sequence[np.ndarray],
    matches: Mapping[tuple[int, int], np.ndarray],
    row: float = 4.5,
) -> None:
    """Write key points, in these columns of a photo's row of pixels, and pairs' matches [M, 2]."""
    xy = np.concatenate([np.stack([x, np.full(len(x), row)], axis=1) for x in columns])
    np.savez(
        folder / KEYPOINTS_FILE,
        names=np.array(names),
        counts=np.array([len(x) for x in columns]),
        xy=xy.astype(np.float32),
        inside=np.zeros(len(xy), bool),
        pairs=np.array(list(matches), dtype=np.int64).reshape(-1, 2),
        pair_counts=np.array([len(m) for m in matches.values()], dtype=np.int64),
        matches=np.concatenate([np.zeros((0, 2)), *matches.values()]).astype(np.uint32),
    )


def scene(folder: Path, spans: list[tuple[int, int]], pairs: list[tuple[int, int]]) -> Scene:
    """Write masks that hold spans of columns, and key points, one a column.

    Those of ``b.jpg`` begin with five that match nothing, those of ``c.jpg`` go from right to left.
    """
    (folder / "masks").mkdir()
    for name, (first, last) in zip(NAMES, spans, strict=True):
        pixels = np.zeros((10, 40), np.uint8)
        pixels[:, first:last] = 255
        cv2.imwrite(str(folder / "masks" / mask_name(name)), pixels)
    columns = [COLUMNS, np.concatenate([np.full(5, 0.5), COLUMNS]), COLUMNS[::-1]]
    rows = [np.arange(40), np.arange(40) + 5, np.arange(40)[::-1]]
    matches = [np.stack([rows[i], rows[j]], axis=1) for i, j in pairs]
    write_key_points(folder, NAMES, columns, dict(zip(pairs, matches, strict=True)))
    return Scene("strips", folder, (), {})


ALL = [(0, 1), (0, 2), (1, 2)]


def test_masks_of_the_same_columns_agree(tmp_path: Path) -> None:
    found = masks_at_shared_points(scene(tmp_path, [(0, 35)] * 3, ALL))
    assert found == (Contradictions(1.0, ()), [])


def test_a_mask_of_other_columns_is_named(tmp_path: Path) -> None:
    found, names = masks_at_shared_points(scene(tmp_path, [(0, 35), (20, 40), (0, 35)], ALL))
    assert names == ["b.jpg"]  # 15 of 40 columns shared with each of the others
    assert found.shared == pytest.approx((35 + 15 + 15) / (35 + 40 + 40))


def test_a_scene_without_matches_is_not_known(tmp_path: Path) -> None:
    found, names = masks_at_shared_points(scene(tmp_path, [(0, 35), (20, 40), (0, 35)], []))
    assert (found.shared, names) == (None, [])
