"""Small copies of a capture's photos: the right ones, and the same pictures as from the photos."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.scene import Scene, SparsePoints, View
from mattgs_ops.segment import sheet

VIEWS, SIZE = 40, (500, 300)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """Return a scene of forty photos of noise, each with a mask."""
    rng = np.random.default_rng(0)
    folder = tmp_path / "scene"
    views = []
    for index in range(VIEWS):
        photo, mask = (folder / kind / f"{index:02d}.jpg.png" for kind in ("photos", "masks"))
        for place, shape in ((photo, (*SIZE[::-1], 3)), (mask, SIZE[::-1])):
            place.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(place), rng.integers(0, 256, shape, dtype=np.uint8))
        views.append(View(f"{index:02d}.jpg", "train", *SIZE, photo, mask, None))
    found = Scene("ball", folder, tuple(views), {})
    none = np.zeros((0, 3))
    found.save(SparsePoints(none, none.astype(np.uint8), np.zeros(0, np.float32), np.zeros(0, int)))
    return found


def test_copies_give_the_same_pictures_as_the_photos(scene: Scene, tmp_path: Path) -> None:
    flags: sheet.Flags = {}
    before = {view.name: sheet.small(view) for view in sheet.chosen(sheet.views_of(scene), flags)}
    sheet.write_copies(scene.folder, tmp_path / "run" / sheet.FOLDER)
    elsewhere = replace(scene, folder=tmp_path / "run")
    after = {
        view.name: sheet.small(view) for view in sheet.chosen(sheet.views_of(elsewhere), flags)
    }
    assert before.keys() == after.keys()
    assert len(after) == sheet.MOST
    for name, pictures in after.items():
        kept = before[name]
        assert pictures is not None
        assert kept is not None
        for one, other in zip(pictures, kept, strict=True):
            assert one.shape[:2] == (192, sheet.WIDTH)
            np.testing.assert_array_equal(one, other)


def test_flagged_photos_come_first(scene: Scene) -> None:
    flags = {f"{index:02d}.jpg": ("small",) for index in range(3, 9)}
    names = {view.name for view in sheet.chosen(scene.views, flags)}
    assert names >= flags.keys()
    assert len(names) == sheet.MOST


def test_what_cannot_be_read_has_no_copy(scene: Scene, tmp_path: Path) -> None:
    scene.views[0].photo.write_bytes(b"no picture")
    scene.views[1].photo.unlink()
    sheet.write_copies(scene.folder, tmp_path)
    names = {path.name for path in (tmp_path / "photos").iterdir()}
    assert not {"00.jpg.png", "01.jpg.png"} & names
    assert len(names) >= sheet.MOST - 1
