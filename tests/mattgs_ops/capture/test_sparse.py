"""Specification of sparse models: files, votes, points."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from plyfile import PlyData

from mattgs_ops.capture import sparse
from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.sparse import ColmapCamera, SparseImage, SparseModel
from mattgs_ops.errors import InputError

SIZE = (64, 48)
INTRINSICS = Intrinsics(*SIZE, 60.0, 61.0, 31.5, 24.5)


def random_rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    return sparse.rotation_of(rng.normal(size=4))


@pytest.fixture
def model() -> SparseModel:
    """Three images of five points; the second image also has a key point without a point."""
    rng = np.random.default_rng(3)
    xyz = rng.uniform(-0.4, 0.4, (5, 3)) + np.array([0, 0, 4])
    images = {}
    for number, seen in ((1, [0, 1, 2, 3, 4]), (2, [3, 1, -1]), (7, [4, 0, 2])):
        rotation = sparse.rotation_of(np.array([1, *rng.normal(0, 0.05, 3)]))
        camera = Camera(INTRINSICS, rotation, rng.normal(0, 0.1, 3))
        points = np.array(seen)
        xy = np.where(points[:, None] < 0, 5.25, camera.project(xyz[points])[0])
        name = f"IMG ü {number}.jpg.png"
        images[number] = SparseImage(name, 4, camera.rotation, camera.translation, xy, points)
    i = INTRINSICS
    camera4 = ColmapCamera("PINHOLE", *SIZE, (i.fx, i.fy, i.cx, i.cy))
    rgb = rng.integers(0, 256, (5, 3), dtype=np.uint8)
    return SparseModel({4: camera4}, images, xyz, rgb, rng.random(5))


def test_quaternions_and_rotations_are_inverse_also_for_half_turns() -> None:
    rng = np.random.default_rng(0)
    half_turns = [np.array(q) for q in ([0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0.6, 0, 0.8])]
    for q in [*rng.normal(size=(50, 4)), *map(np.asarray, half_turns), np.array([1.0, 0, 0, 0])]:
        rotation = sparse.rotation_of(q.astype(float))
        assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        back = sparse.quaternion_of(rotation)
        assert back[0] >= 0
        assert np.allclose(sparse.rotation_of(back), rotation, atol=1e-12)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    quarter = sparse.rotation_of(np.array([1.0, 0, 0, 1.0]))
    assert np.allclose(quarter @ [1, 0, 0], [0, 1, 0])


def test_what_is_written_is_read_back(model: SparseModel, tmp_path: Path) -> None:
    sparse.write_model(model, tmp_path)
    back = sparse.read_model(tmp_path)
    assert back.cameras == model.cameras
    assert np.array_equal(back.xyz, model.xyz)
    assert np.array_equal(back.rgb, model.rgb)
    assert np.array_equal(back.error, model.error)
    assert set(back.images) == set(model.images)
    for number, image in model.images.items():
        other = back.images[number]
        assert (other.name, other.camera) == (image.name, image.camera)
        assert np.allclose(other.rotation, image.rotation, atol=1e-14)
        assert np.array_equal(other.translation, image.translation)
        assert np.array_equal(other.xy, image.xy)
        assert np.array_equal(other.points, image.points)


COLMAP_READS = """
import sys, pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
model.update_point_3d_errors()
tracks = sorted(point.track.length() for point in model.points3D.values())
print(model.num_reg_images(), model.num_points3D(), model.compute_mean_reprojection_error(), tracks)
print([model.image(n).name for n in sorted(model.reg_image_ids())])
model.write_binary(sys.argv[2])
"""


def test_colmap_reads_our_files_and_we_read_colmaps(model: SparseModel, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    theirs.mkdir()
    sparse.write_model(model, ours)
    done = subprocess.run(
        [sys.executable, "-c", COLMAP_READS, str(ours), str(theirs)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    first, names = done.stdout.splitlines()
    images, points, error, tracks = first.split(" ", 3)
    assert (int(images), int(points), tracks) == (3, 5, "[2, 2, 2, 2, 2]")
    assert float(error) < 1e-9  # key points were projected exactly: all conventions agree
    assert names == str([image.name for image in model.images.values()])
    back = sparse.read_model(theirs)
    assert np.allclose(back.xyz, model.xyz)
    number, point, xy = back.observations()
    for n, p, pixel in zip(number, point, xy, strict=True):
        image = back.images[n]
        camera = Camera(INTRINSICS, image.rotation, image.translation)
        assert np.allclose(camera.project(back.xyz[p][None])[0][0], pixel, atol=1e-6)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_file_cut_short_is_named(model: SparseModel, tmp_path: Path, file: str) -> None:
    sparse.write_model(model, tmp_path)
    data = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(data[:-3])
    with pytest.raises(InputError, match=rf"{file}: expected a whole COLMAP model"):
        sparse.read_model(tmp_path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cameras\.bin: expected a readable COLMAP model"):
        sparse.read_model(tmp_path)


def test_an_unknown_camera_model_is_refused(model: SparseModel, tmp_path: Path) -> None:
    sparse.write_model(model, tmp_path)
    data = bytearray((tmp_path / "cameras.bin").read_bytes())
    data[12] = 5  # the model's number follows the count (8 bytes) and the camera's number (4)
    (tmp_path / "cameras.bin").write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"expected a camera model of .*PINHOLE.*; found number 5"):
        sparse.read_model(tmp_path)


def test_views_vote_on_points_by_their_masks() -> None:
    # five views from the same place see points 0 and 1; four masks hold point 0, three point 1
    xyz = np.array([[0.0, 0, 2], [0.5, 0, 2]])
    camera = Camera(INTRINSICS, np.eye(3), np.zeros(3))
    pixels, _ = camera.project(xyz)
    images, cameras, masks = {}, {}, {}
    for k in range(5):
        images[k] = SparseImage(f"{k}", 1, np.eye(3), np.zeros(3), pixels, np.array([0, 1]))
        cameras[k] = camera
        masks[k] = np.zeros(SIZE[::-1], dtype=np.uint8)
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
    camera = Camera(INTRINSICS, np.eye(3), np.zeros(3))
    pixels, _ = camera.project(xyz)
    seeing = SparseImage("a", 1, np.eye(3), np.zeros(3), pixels, np.array([0]))
    blind = SparseImage("b", 1, np.eye(3), np.zeros(3), pixels, np.array([-1]))
    white = np.full(SIZE[::-1], 255, dtype=np.uint8)
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
    points = sparse.SparsePoints(xyz, rgb, share, np.ones(7, dtype=np.int32))
    sparse.write_ply(points, tmp_path / "p.ply")
    read = PlyData.read(tmp_path / "p.ply")["vertex"]
    assert np.array_equal(np.stack([read[k] for k in "xyz"], 1), xyz.astype(np.float32))
    assert np.array_equal(np.stack([read[k] for k in ("red", "green", "blue")], 1), rgb)
    assert np.array_equal(read["object_share"], share)
