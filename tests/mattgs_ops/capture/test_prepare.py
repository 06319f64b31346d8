"""From photos on disk to a prepared capture, and every refusal before any work."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mattgs_ops.capture.prepare import prepare
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError
from tests.mattgs_ops.capture.conftest import (
    HEIGHT,
    NAMES,
    WIDTH,
    disc,
    picture,
    pixels,
    refusal,
    run,
    write_colmap,
    write_cutouts,
    write_masks,
    write_photos,
    write_transforms,
)
from tests.reference.opengl import to_opengl


def test_a_plain_folder(tmp_path: Path) -> None:
    capture = run(write_photos(tmp_path / "in"), tmp_path / "out")
    assert [view.name for view in capture.views] == NAMES
    assert [v.name for v in capture.views if v.split == "test"] == [NAMES[i] for i in (0, 4, 8)]
    assert (capture.masks_are, capture.cameras_are) == ("none", "none")
    for seed, view in enumerate(capture.views):
        assert view.photo == tmp_path / "out" / "photos" / f"{view.name}.png"
        np.testing.assert_array_equal(pixels(view.photo), picture(seed))
        assert (view.width, view.height, view.mask, view.camera) == (WIDTH, HEIGHT, None, None)
    assert PreparedCapture.load(capture.folder) == capture


def test_a_folder_that_holds_images(tmp_path: Path) -> None:
    write_photos(tmp_path / "in" / "images")
    (tmp_path / "in" / "notes.txt").write_text("beside the photos' folder: not our business")
    assert len(run(tmp_path / "in", tmp_path / "out").views) == len(NAMES)


def test_progress_counts_each_photo_checked_and_written(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    run(
        write_photos(tmp_path / "in"),
        tmp_path / "out",
        progress=lambda done, total, _: seen.append((done, total)),
    )
    assert seen == [(i + 1, 20) for i in range(20)]


def test_exif_orientation_is_baked_in(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    for seed, name in enumerate(NAMES):
        exif = Image.Exif()
        exif[0x0112] = 6
        Image.fromarray(picture(seed)).save(folder / name, exif=exif)
    view = run(folder, tmp_path / "out").views[3]
    assert (view.width, view.height) == (HEIGHT, WIDTH)
    np.testing.assert_array_equal(pixels(view.photo), np.rot90(picture(3), -1))


def test_large_photos_are_reduced_by_area(tmp_path: Path) -> None:
    view = run(write_photos(tmp_path / "in"), tmp_path / "out", max_size=24).views[0]
    assert (view.width, view.height, view.as_taken) == (24, 18, (48, 36))
    mean = picture(0).reshape(18, 2, 24, 2, 3).mean(axis=(1, 3))
    assert np.abs(pixels(view.photo) - mean).max() <= 1


@pytest.mark.parametrize("form", ["{name}.png", "{stem}.png"])
@pytest.mark.parametrize(
    "place", ["in/masks", "in/Masks", "in/images/masks", "elsewhere", "in/images/own"]
)
def test_masks_are_found(tmp_path: Path, place: str, form: str) -> None:
    write_photos(tmp_path / "in" / "images")
    write_masks(tmp_path / place, disc(), form)
    own = {"masks": tmp_path / place} if place in ("elsewhere", "in/images/own") else {}
    capture = run(tmp_path / "in", tmp_path / "out", **own)
    assert capture.masks_are == "given"
    for view in capture.views:
        assert view.mask == tmp_path / "out" / "masks" / f"{view.name}.png"
        np.testing.assert_array_equal(pixels(view.mask), disc())


def test_masks_beside_the_named_folder_of_images_are_found(tmp_path: Path) -> None:
    write_photos(tmp_path / "in" / "images")
    write_masks(tmp_path / "in" / "masks", disc())
    assert run(tmp_path / "in" / "images", tmp_path / "out").masks_are == "given"


def test_alpha_is_the_mask_and_the_photo_stands_on_white(tmp_path: Path) -> None:
    write_cutouts(tmp_path / "in")
    capture = run(tmp_path / "in", tmp_path / "out")
    assert capture.masks_are == "alpha"
    view = capture.views[2]
    np.testing.assert_array_equal(pixels(view.mask), disc())
    photo = pixels(view.photo)
    np.testing.assert_array_equal(photo[disc() > 0], picture(2)[disc() > 0])
    assert (photo[disc() == 0] == 255).all()


def test_the_users_own_masks_go_before_alpha(tmp_path: Path) -> None:
    write_cutouts(tmp_path / "in")
    other = np.roll(disc(), 4, axis=1)
    write_masks(tmp_path / "own", other)
    capture = run(tmp_path / "in", tmp_path / "out", masks=tmp_path / "own")
    assert capture.masks_are == "given"
    np.testing.assert_array_equal(pixels(capture.views[0].mask), other)


def test_nerfstudio_cameras_are_kept_and_scaled_with_the_photos(tmp_path: Path) -> None:
    capture = run(write_transforms(tmp_path / "in"), tmp_path / "out", max_size=24)
    assert capture.cameras_are == "given"
    camera = capture.views[1].camera
    assert camera is not None
    assert (camera.intrinsics.width, camera.intrinsics.fx, camera.intrinsics.cy) == (24, 25, 9)
    np.testing.assert_allclose(to_opengl(camera.rotation, camera.translation), np.eye(4))
    loaded = PreparedCapture.load(capture.folder).views[1].camera
    assert loaded is not None
    np.testing.assert_array_equal(loaded.rotation, camera.rotation)


def test_nerfstudio_frames_are_the_capture(tmp_path: Path) -> None:
    """Photos in the folder that no frame lists are not part of it."""
    capture = run(write_transforms(tmp_path / "in", NAMES[3:]), tmp_path / "out")
    assert [view.name for view in capture.views] == NAMES[3:]


def test_masks_named_by_frames_are_taken(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "in")
    write_masks(folder / "cut", disc(), "m_{stem}.png")
    data = json.loads((folder / "transforms.json").read_text())
    for frame in data["frames"]:
        frame["mask_path"] = f"cut/m_{Path(frame['file_path']).stem}.png"
    (folder / "transforms.json").write_text(json.dumps(data))
    capture = run(folder, tmp_path / "out")
    assert capture.masks_are == "given"
    np.testing.assert_array_equal(pixels(capture.views[5].mask), disc())


def test_distortion_is_removed_from_photos_and_masks(tmp_path: Path) -> None:
    write_transforms(tmp_path / "in", camera_model="OPENCV", k1=-0.3)
    write_masks(tmp_path / "in" / "masks", disc())
    view = run(tmp_path / "in", tmp_path / "out").views[0]
    assert view.camera is not None
    assert view.camera.intrinsics.fx != 50  # zoomed so that no empty border is seen
    assert np.abs(pixels(view.photo).astype(int) - picture(0)).max() > 0
    mask = pixels(view.mask)
    assert set(np.unique(mask)) == {0, 255}
    assert mask[18, 24] == 255
    assert mask[0, 0] == 0


def test_photos_of_all_sizes_and_both_orientations_are_taken(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    Image.fromarray(picture(4, WIDTH, HEIGHT)).save(folder / NAMES[4])
    Image.fromarray(picture(5, 20, 30)).save(folder / NAMES[5])
    views = run(folder, tmp_path / "out", max_size=40).views
    assert [(v.width, v.height) for v in views[3:6]] == [(40, 30), (30, 40), (30, 20)]


@pytest.mark.parametrize("form", ["{name}.png", "{stem}.png"])
def test_photos_in_folders_keep_the_folder_in_their_name(tmp_path: Path, form: str) -> None:
    for side in ("left", "right"):
        write_photos(tmp_path / "in" / side, NAMES[:3])
        masks = tmp_path / "in" / "masks" / side
        masks.mkdir(parents=True)
        for name in NAMES[:3]:
            Image.fromarray(disc()).save(masks / form.format(name=name, stem=Path(name).stem))
    capture = run(tmp_path / "in", tmp_path / "out")
    names = [f"{side}__{name}" for side in ("left", "right") for name in NAMES[:3]]
    assert [view.name for view in capture.views] == names
    assert capture.masks_are == "given"
    assert capture.views[4].photo == capture.folder / "photos" / f"right__{NAMES[1]}.png"
    np.testing.assert_array_equal(pixels(capture.views[4].photo), picture(1))


def test_a_focal_length_in_exif_is_scaled_with_the_photo(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    exif = Image.Exif()
    exif[0x8769], exif[0x0110] = {0xA405: 43}, "Camera 1"  # mm: about the film's diagonal
    Image.fromarray(picture(2)).save(folder / NAMES[2], exif=exif)
    views = run(folder, tmp_path / "out", max_size=24).views
    assert (views[1].focal, views[1].lens, views[2].lens) == (None, "", "Camera 1")
    assert views[2].focal == pytest.approx(43 / 43.267 * 30, rel=1e-3)  # diagonal of 24 x 18
    assert PreparedCapture.load(tmp_path / "out").views == views


@pytest.mark.parametrize("posed", [True, False])
def test_a_split_in_lists_beside_the_photos_is_kept(tmp_path: Path, posed: bool) -> None:
    write_transforms(tmp_path / "in") if posed else write_photos(tmp_path / "in" / "images")
    (tmp_path / "in" / "train.txt").write_text("\n".join(NAMES[:6]))
    (tmp_path / "in" / "test.txt").write_text(f"# held out\n{NAMES[7]}\nimages/{NAMES[8]}\n")
    capture = PreparedCapture.load(run(tmp_path / "in", tmp_path / "out").folder)
    assert [v.name for v in capture.views] == [*NAMES[:6], *NAMES[7:9]]
    assert [v.split for v in capture.views] == ["train"] * 6 + ["test"] * 2
    assert (capture.split_is, capture.left_out) == ("given", (NAMES[6], NAMES[9]))


def test_colmap_photos_without_a_pose_stay_in_the_split(tmp_path: Path) -> None:
    capture = run(write_colmap(tmp_path / "in", NAMES[1:]), tmp_path / "out")
    assert capture.cameras_are == "given"
    assert [view.name for view in capture.views] == NAMES
    assert capture.views[0].camera is None
    assert capture.views[0].split == "test"
    camera = capture.views[2].camera
    assert camera is not None
    assert camera.translation.tolist() == [0, 0, 1]


def test_the_split_of_a_colmap_project_is_kept(tmp_path: Path) -> None:
    folder = write_colmap(tmp_path / "in", NAMES)
    (folder / "sparse" / "0" / "test.txt").write_text(f"{NAMES[3]}\n{NAMES[4]}\n")
    capture = run(folder, tmp_path / "out")
    assert [v.name for v in capture.views if v.split == "test"] == [NAMES[3], NAMES[4]]
    assert capture.left_out == ()


def test_points_of_a_colmap_project_come_along(tmp_path: Path) -> None:
    folder = write_colmap(tmp_path / "in", NAMES)
    model = folder / "sparse" / "0"
    (model / "points3D.txt").write_text("7 1 2 3 10 20 30 0.5 1 0 2 0\n9 4 5 6 40 50 60 0.5 2 1\n")
    rows = [f"{i + 1} 1 0 0 0 0 0 {i} 1 {name}\n" for i, name in enumerate(NAMES)]
    seen = {0: "1 2 7\n", 1: "1 2 7 3 4 9\n"}
    text = "".join(row + seen.get(i, "\n") for i, row in enumerate(rows))
    (model / "images.txt").write_text(text)
    points = run(folder, tmp_path / "out").points
    assert points is not None
    assert points.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert points.rgb.tolist() == [[10, 20, 30], [40, 50, 60]]
    found = [(points.photos[photo], int(point)) for photo, point in points.seen]
    assert found == [(NAMES[0], 0), (NAMES[1], 0), (NAMES[1], 1)]


def test_points_of_a_ply_file_come_along(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "in", ply_file_path="cloud.ply")
    header = "ply\nformat ascii 1.0\nelement vertex 2\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    (folder / "cloud.ply").write_text(header + "1 2 3\n4 5 6\n")
    points = run(folder, tmp_path / "out").points
    assert points is not None
    assert points.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert len(points.seen) == 0


def test_damaged_points_are_refused(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "in", ply_file_path="cloud.ply")
    (folder / "cloud.ply").write_text("ply\nformat ascii 1.0\nelement vertex 2\n")
    assert "cloud.ply: expected a PLY file of points" in refusal(folder, tmp_path / "out")


def test_kind_overrides_what_was_detected(tmp_path: Path) -> None:
    capture = run(write_transforms(tmp_path / "in", NAMES[3:]), tmp_path / "out", kind="photos")
    assert capture.cameras_are == "none"
    assert len(capture.views) == len(NAMES)


def test_bundled_captures_hold_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_transforms(tmp_path / "bundled" / "rover")
    write_masks(tmp_path / "bundled" / "rover" / "masks", disc())
    monkeypatch.setattr("mattgs_ops.capture.source.BUNDLED_FOLDER", tmp_path / "bundled")
    capture = prepare(CaptureConfig(name="rover"), tmp_path / "out", test_every=8)
    assert (capture.masks_are, capture.cameras_are) == ("truth", "truth")
    with pytest.raises(InputError, match="bundled capture is missing"):
        prepare(CaptureConfig(name="hexapod"), tmp_path / "out", test_every=8)


# ------------------------------------------------------------------------------- refusals


@pytest.mark.real_data
@pytest.mark.parametrize(("name", "masks_are"), [("lego", "alpha"), ("fox", "none")])
def test_real_captures(tmp_path: Path, real_data: Path, name: str, masks_are: str) -> None:
    """The first nine frames of each, as published."""
    data = json.loads((real_data / name / "transforms.json").read_text())
    data["frames"] = data["frames"][:9]
    (tmp_path / "images").symlink_to(real_data / name / "images")
    (tmp_path / "transforms.json").write_text(json.dumps(data))
    capture = run(tmp_path, tmp_path / "out", test_every=8, max_size=200)
    assert (capture.masks_are, capture.cameras_are) == (masks_are, "given")
    assert [view.split for view in capture.views] == ["test", *["train"] * 7, "test"]
    assert all(max(view.width, view.height) == 200 for view in capture.views)


@pytest.mark.real_data
def test_nerfs_own_layout_as_published(tmp_path: Path, real_data: Path) -> None:
    capture = run(real_data / "lego_nerf", tmp_path / "out", max_size=50)
    assert (capture.masks_are, capture.cameras_are) == ("alpha", "given")
    assert capture.split_is == "given"
    splits = [view.split for view in capture.views]
    assert (splits.count("train"), splits.count("test")) == (100, 200)
    assert capture.views[0].name == "test__r_0.png"
