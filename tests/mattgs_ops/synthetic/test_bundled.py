"""The shipped captures are whole, small enough, and consistent in themselves."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import mattgs_ops
from mattgs_ops.capture.camera import Camera, Intrinsics, from_opengl
from mattgs_ops.config import BUNDLED
from mattgs_ops.synthetic.contact_sheet import contact_sheet

FOLDER = Path(mattgs_ops.__file__).parent / "bundled"
VIEWS, TEST_VIEWS, SIZE = 48, 24, (800, 600)
TRAIN = [f"{k:04d}.jpg" for k in range(VIEWS)]
TEST = [f"test_{k:04d}.jpg" for k in range(TEST_VIEWS)]
BUDGET = 45e6  # bytes, all three together


@pytest.fixture(params=BUNDLED)
def folder(request: pytest.FixtureRequest) -> Path:
    return FOLDER / str(request.param)


def masks(folder: Path) -> dict[str, np.ndarray]:
    return {
        p.name.removesuffix(".png"): np.asarray(Image.open(p)) for p in (folder / "masks").iterdir()
    }


def cameras(folder: Path) -> dict[str, Camera]:
    data = json.loads((folder / "transforms.json").read_text())
    pinhole = Intrinsics(data["w"], data["h"], data["fl_x"], data["fl_y"], data["cx"], data["cy"])
    return {
        Path(frame["file_path"]).name: Camera(
            pinhole, *from_opengl(np.array(frame["transform_matrix"]))
        )
        for frame in data["frames"]
    }


def test_all_captures_fit_their_budget() -> None:
    files = [p for name in BUNDLED for p in (FOLDER / name).rglob("*") if p.is_file()]
    assert sum(p.stat().st_size for p in files) <= BUDGET


def test_photos_masks_and_cameras_belong_together(folder: Path) -> None:
    assert sorted(p.name for p in (folder / "images").iterdir()) == TRAIN + TEST
    assert sorted(cameras(folder)) == TRAIN + TEST
    assert sorted(masks(folder)) == TRAIN + TEST
    for path in (folder / "images").iterdir():
        with Image.open(path) as photo:
            assert (photo.size, photo.mode, photo.format) == (SIZE, "RGB", "JPEG")


def test_the_split_is_the_captures_own(folder: Path) -> None:
    data = json.loads((folder / "transforms.json").read_text())
    assert data["train_filenames"] == [f"images/{name}" for name in TRAIN]
    assert data["test_filenames"] == [f"images/{name}" for name in TEST]


def test_masks_hold_each_pixels_share_and_the_object_whole(folder: Path) -> None:
    for name, mask in masks(folder).items():
        assert mask.shape == SIZE[::-1]
        assert mask.dtype == np.uint8
        partly = (mask > 0) & (mask < 255)
        assert 0.001 < partly.mean() < 0.04, "the outline is partly covered, and nothing else"
        assert 0.1 < (mask > 127).mean() < 0.35, name
        rows, columns = np.nonzero(mask > 127)
        assert abs(columns.mean() / SIZE[0] - 0.5) < 0.15, name
        assert abs(rows.mean() / SIZE[1] - 0.5) < 0.2, name
        sides = np.concatenate([mask[:, 0], mask[:, -1]])
        assert not sides.any(), name


def test_known_points_of_the_object_project_into_its_masks(folder: Path) -> None:
    corners = np.array(json.loads((folder / "object.json").read_text())["corners"])
    assert len(corners) >= 24
    found = masks(folder)
    hits = []
    for name, camera in cameras(folder).items():
        pixels, depth = camera.project(corners)
        assert (depth > 0).all()
        columns, rows = np.floor(pixels).astype(int).T
        grown = cv2.dilate(found[name], np.ones((3, 3), np.uint8))
        in_frame = (columns >= 0) & (columns < SIZE[0]) & (rows >= 0) & (rows < SIZE[1])
        hits.append(grown[rows[in_frame], columns[in_frame]] > 0)
    # something small may stand before a corner in a few views
    assert np.concatenate(hits).mean() > 0.98


def test_small_structures_lie_on_the_object_in_every_test_view(folder: Path) -> None:
    found = masks(folder)
    paths = sorted((folder / "ids").iterdir())
    assert [p.name.removesuffix(".png") for p in paths] == TEST
    for path in paths:
        with Image.open(path) as image:
            assert image.mode == "P"
            ids = np.asarray(image)
        assert set(np.unique(ids).tolist()) == {0, 1, 2, 3}, path
        grown = cv2.dilate(found[path.name.removesuffix(".png")], np.ones((3, 3), np.uint8))
        assert (grown[ids > 0] > 0).all(), path


def test_the_surroundings_hold_more_features_than_the_object(folder: Path) -> None:
    name = "0024.jpg"
    grey = cv2.imread(str(folder / "images" / name), cv2.IMREAD_GRAYSCALE)
    points = np.array([k.pt for k in cv2.SIFT.create().detect(grey)]).astype(int)
    inside = masks(folder)[name][points[:, 1], points[:, 0]] > 0
    assert inside.sum() > 200
    assert (~inside).sum() > inside.sum()


def test_a_contact_sheet_shows_photos_over_masks(folder: Path) -> None:
    page = contact_sheet(folder)
    assert page.shape == (6 * 240, 4 * 320, 3)
    photos, cut = page[:240].astype(float), page[240:480].astype(float)
    assert cut.mean() < 0.6 * photos.mean()
