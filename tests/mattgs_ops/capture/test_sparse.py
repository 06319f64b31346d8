"""Specification of sparse models: files, votes, points."""

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from mattgs_ops.capture import sparse
from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.scene import SparsePoints
from mattgs_ops.capture.sparse import SparseImage, SparseModel
from tests.mattgs_ops.capture.conftest import SPARSE_INTRINSICS, SPARSE_SIZE


def test_views_vote_on_points_by_their_masks() -> None:
    # five views from the same place see points 0 and 1; four masks hold point 0, three point 1
    xyz = np.array([[0.0, 0, 2], [0.5, 0, 2]])
    camera = Camera(SPARSE_INTRINSICS, np.eye(3), np.zeros(3))
    pixels, _ = camera.project(xyz)
    images, cameras, masks = {}, {}, {}
    for k in range(5):
        images[k] = SparseImage(f"{k}", 1, np.eye(3), np.zeros(3), pixels, np.array([0, 1]))
        cameras[k] = camera
        masks[k] = np.zeros(SPARSE_SIZE[::-1], dtype=np.uint8)
        for p, enough in ((0, 4), (1, 3)):
            if k < enough:
                x, y = np.floor(pixels[p]).astype(int)
                masks[k][y, x] = 255
    rgb = np.array([[1, 2, 3], [4, 5, 6]], dtype=np.uint8)
    model = SparseModel({}, images, xyz, rgb, np.zeros(2))
    points = sparse.object_points(model, cameras, masks)
    assert points.object_share.tolist() == pytest.approx([0.8, 0.6])
    assert points.views_seen.tolist() == [5, 5]
    kept = sparse.on_object(points)  # at the threshold counts as on the object
    assert np.array_equal(kept.xyz, xyz[:1])
    assert np.array_equal(kept.rgb, rgb[:1])


def test_only_views_that_see_a_point_vote() -> None:
    xyz = np.array([[0.0, 0, 2]])
    camera = Camera(SPARSE_INTRINSICS, np.eye(3), np.zeros(3))
    pixels, _ = camera.project(xyz)
    seeing = SparseImage("a", 1, np.eye(3), np.zeros(3), pixels, np.array([0]))
    blind = SparseImage("b", 1, np.eye(3), np.zeros(3), pixels, np.array([-1]))
    white = np.full(SPARSE_SIZE[::-1], 255, dtype=np.uint8)
    model = SparseModel({}, {1: seeing, 2: blind}, xyz, np.zeros((1, 3), np.uint8), np.zeros(1))
    points = sparse.object_points(model, {1: camera, 2: camera}, {1: white, 2: 0 * white})
    assert (points.object_share[0], points.views_seen[0]) == (1.0, 1)


def test_projections_behind_or_beside_the_image_are_not_inside() -> None:
    mask = np.full((4, 6), 255, dtype=np.uint8)
    pixels = np.array([[0.0, 0.0], [5.999, 3.999], [6.0, 2.0], [-0.001, 1.0], [2, 2], [np.nan, 1]])
    depths = np.array([1.0, 1, 1, 1, -1, 1])
    assert sparse.inside(mask, pixels, depths).tolist() == [True, True, False, False, False, False]


def test_points_are_written_as_a_ply_that_others_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    xyz, rgb = rng.normal(size=(7, 3)), rng.integers(0, 256, (7, 3), dtype=np.uint8)
    share = rng.random(7).astype(np.float32)
    points = SparsePoints(xyz, rgb, share, np.ones(7, dtype=np.int32))
    sparse.write_ply(points, tmp_path / "p.ply")
    read = PlyData.read(tmp_path / "p.ply")["vertex"]
    assert np.array_equal(np.stack([read[k] for k in "xyz"], 1), xyz.astype(np.float32))
    assert np.array_equal(np.stack([read[k] for k in ("red", "green", "blue")], 1), rgb)
    assert np.array_equal(read["object_share"], share)


def test_all_views_vote_on_a_point_that_none_is_known_to_see() -> None:
    """Points of a cloud's file: whoever has them in frame says whether they are on the object."""
    xyz = np.array([[0.0, 0, 2], [0.5, 0, 2], [50.0, 0, 2]])
    camera = Camera(SPARSE_INTRINSICS, np.eye(3), np.zeros(3))
    images = {
        n: SparseImage(
            f"{n}", 1, camera.rotation, camera.translation, np.zeros((0, 2)), np.zeros(0, np.int64)
        )
        for n in (1, 2)
    }
    i = SPARSE_INTRINSICS
    lens = ColmapCamera("PINHOLE", *SPARSE_SIZE, (i.fx, i.fy, i.cx, i.cy))
    model = SparseModel({1: lens}, images, xyz, np.zeros((3, 3), np.uint8), np.zeros(3))
    left = np.zeros(SPARSE_SIZE[::-1], np.uint8)
    left[:, :40] = 255  # holds the first point, at column 31
    points = sparse.object_points(
        model, {1: camera, 2: camera}, {1: left, 2: np.full_like(left, 255)}
    )
    assert points.views_seen.tolist() == [2, 2, 0]  # the third is in nobody's frame
    assert points.object_share.tolist() == [1.0, 0.5, 0.0]
