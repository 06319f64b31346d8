"""Specification of what becomes of lens distortion between COLMAP's model and a scene."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.capture.sparse import SparseImage, SparseModel
from mattgs_ops.sfm import assemble

SIZE = (320, 240)


def test_the_largest_shift_is_that_of_the_farthest_corner() -> None:
    lens = ColmapCamera("SIMPLE_RADIAL", *SIZE, (400.0, 160.0, 120.0, -0.1)).lens()
    radius = 200 / 400  # the corner is 200 pixels from the centre
    assert assemble.largest_shift(lens) == pytest.approx(400 * 0.1 * radius**3)


def test_a_distortion_that_nobody_sees_is_not_worth_a_resampling() -> None:
    slight = ColmapCamera("SIMPLE_RADIAL", *SIZE, (400.0, 160.0, 120.0, 0.004))
    assert assemble.pinhole_conversion(slight).resample is None
    strong = ColmapCamera("SIMPLE_RADIAL", *SIZE, (400.0, 160.0, 120.0, 0.006))
    assert assemble.pinhole_conversion(strong).resample is not None


@pytest.mark.parametrize(("k", "threads"), [(-0.15, 1), (0.12, 3)])
def test_dots_photos_masks_and_key_points_move_together(
    tmp_path: Path, k: float, threads: int
) -> None:
    """A dot drawn where the lens puts it is found where the pinhole puts it."""
    camera = ColmapCamera("SIMPLE_RADIAL", *SIZE, (300.0, 160.0, 120.0, k))
    rays = np.array([[0.3, 0.2], [-0.35, 0.25], [0.0, -0.3], [0.4, -0.05]])
    lens = rays * (1 + k * (rays**2).sum(axis=1, keepdims=True)) * 300 + [160, 120]
    (tmp_path / "photos").mkdir()
    (tmp_path / "masks").mkdir()
    views, images = [], {}
    for n, pixel in enumerate(lens):
        u, v = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
        blob = 255 * np.exp(-((u - pixel[0]) ** 2 + (v - pixel[1]) ** 2) / (2 * 3**2))
        photo = tmp_path / "photos" / f"{n}.jpg.png"
        cv2.imwrite(str(photo), np.rint(blob).astype(np.uint8)[..., None].repeat(3, axis=2))
        mask = tmp_path / "masks" / photo.name
        cv2.imwrite(str(mask), np.where(blob > 100, 255, 0).astype(np.uint8))
        for folder in ("soft", "soft/1", "soft/10"):
            (tmp_path / folder).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / folder / photo.name), np.rint(blob).astype(np.uint8))
        views.append(View(f"{n}.jpg", "train", *SIZE, photo, mask, None, ids=mask))
        images[n + 1] = SparseImage(
            photo.name, 1, np.eye(3), np.zeros(3), pixel[None], np.array([n])
        )
    capture = PreparedCapture("dots", tmp_path, tuple(views), "given", "none")
    xyz = np.concatenate([rays, np.ones((4, 1))], axis=1) * 5
    model = SparseModel({1: camera}, images, xyz, np.zeros((4, 3), np.uint8), np.zeros(4))

    out, pinholes, conversions = assemble.write_views(
        capture, tmp_path / "masks", model, tmp_path / "out", tmp_path / "soft", threads=threads
    )
    keypoints = tmp_path / "k.npz"
    np.savez(keypoints, names=np.array([v.name for v in views]), counts=np.ones(4, int), xy=lens)
    assemble.write_keypoints(keypoints, conversions, tmp_path / "out" / "k.npz")
    moved = np.load(tmp_path / "out" / "k.npz")["xy"]
    for n, view in enumerate(out):
        assert view.camera is not None
        assert (view.camera.intrinsics.width, view.camera.intrinsics.height) == SIZE
        expected = view.camera.project(xyz[n : n + 1])[0][0]
        assert np.allclose(pinholes.images[n + 1].xy[0], expected, atol=1e-3)
        assert np.allclose(moved[n], expected, atol=1e-3)
        soft = [tmp_path / "out" / "soft" / one / f"{view.name}.png" for one in ("", "1", "10")]
        for path in (view.photo, view.mask, view.ids, *soft):
            assert path is not None
            assert path.is_relative_to(tmp_path / "out")
            picture = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=float)
            v, u = np.indices(picture.shape) + 0.5
            centre = [(u * picture).sum(), (v * picture).sum()] / picture.sum()
            # ids are whole numbers: each pixel is its nearest neighbour's
            off = 0.6 if path == view.ids else 0.35
            assert np.allclose(centre, expected, atol=off), path
    points = assemble.vote(out, pinholes, threads=threads)
    assert points.object_share.tolist() == [1, 1, 1, 1]
    assert points.views_seen.tolist() == [1, 1, 1, 1]


def test_a_view_in_which_nothing_was_found_has_no_vote(
    box_capture: PreparedCapture, tmp_path: Path
) -> None:
    """Of 0.8 of the views that see a point, a single black mask would take the object away."""
    views = tuple(view for view in box_capture.views if view.split == "train")[:4]
    xyz = np.array([[0.0, 0.0, 0.35], [0.3, 0.2, 0.35]])  # within the box
    images = {}
    for number, view in enumerate(views):
        assert view.camera is not None
        pixels, _ = view.camera.project(xyz)
        pose = view.camera.rotation, view.camera.translation
        images[number] = SparseImage(view.photo.name, 1, *pose, pixels, np.arange(2))
    lens = ColmapCamera("PINHOLE", 240, 180, (1.0, 1.0, 0.0, 0.0))
    model = SparseModel({1: lens}, images, xyz, np.zeros((2, 3), np.uint8), np.zeros(2))
    assert (assemble.vote(views, model).object_share == 1).all()
    black = tmp_path / f"{views[0].name}.png"
    assert views[0].mask is not None
    cv2.imwrite(str(black), np.zeros_like(cv2.imread(str(views[0].mask), cv2.IMREAD_GRAYSCALE)))
    dropped = (replace(views[0], mask=black), *views[1:])
    assert (assemble.vote(dropped, model).object_share == 1).all()
