"""The digest of a capture: by contents and names, whatever form the capture has."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError
from tasks.stages.capture_files import capture_digest, ids_digest


def digest(path: Path, **settings: object) -> str:
    return capture_digest(CaptureConfig.model_validate({"name": "a", "path": path, **settings}))


def nested(root: Path) -> None:
    for side in ("left", "right"):
        (root / "images" / side).mkdir(parents=True)
        for index in range(3):
            colour = (index * 40, 10, 20)
            Image.new("RGB", (8, 6), colour).save(root / "images" / side / f"{index}.png")


def nerf(root: Path) -> None:
    for part in ("train", "test"):
        (root / part).mkdir(parents=True)
        Image.new("RGB", (8, 6)).save(root / part / "r_0.png")
        matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        frame = f'{{"file_path": "./{part}/r_0", "transform_matrix": {matrix}}}'
        text = f'{{"camera_angle_x": 1.0, "frames": [{frame}]}}'
        (root / f"transforms_{part}.json").write_text(text)


FORMS = {"nested": (nested, "images/right/1.png"), "nerf": (nerf, "test/r_0.png")}


@pytest.mark.parametrize("form", FORMS)
def test_a_copy_is_the_same_and_an_edited_photo_is_not(tmp_path: Path, form: str) -> None:
    make: Callable[[Path], None] = FORMS[form][0]
    make(tmp_path / "a")
    shutil.copytree(tmp_path / "a", tmp_path / "elsewhere" / "b")
    before = digest(tmp_path / "a")
    assert digest(tmp_path / "elsewhere" / "b") == before
    Image.new("RGB", (8, 6), (1, 2, 3)).save(tmp_path / "a" / FORMS[form][1])
    assert digest(tmp_path / "a") != before


def test_lists_masks_and_points_count(tmp_path: Path) -> None:
    nested(tmp_path / "a")
    seen = [digest(tmp_path / "a")]
    (tmp_path / "a" / "test.txt").write_text("left/0.png\n")
    seen.append(digest(tmp_path / "a"))
    (tmp_path / "a" / "masks" / "left").mkdir(parents=True)
    Image.new("L", (8, 6)).save(tmp_path / "a" / "masks" / "left" / "0.png")
    seen.append(digest(tmp_path / "a"))
    (tmp_path / "own" / "left").mkdir(parents=True)
    Image.new("L", (8, 6)).save(tmp_path / "own" / "left" / "0.png")
    seen.append(digest(tmp_path / "a", masks=tmp_path / "own"))
    assert len(set(seen)) == len(seen)


def test_id_maps_of_a_rendered_capture_count(tmp_path: Path) -> None:
    nerf(tmp_path / "a")
    (tmp_path / "a" / "object.json").write_text("{}")  # as `mattgs captures render` leaves it
    (tmp_path / "a" / "ids").mkdir()
    capture = CaptureConfig(name="a", path=tmp_path / "a")
    seen = []
    for value in (0, 1):
        Image.new("L", (8, 6), value).save(tmp_path / "a" / "ids" / "r_0.png")
        seen.append(ids_digest(capture))
    assert seen[0] != seen[1]
    (tmp_path / "a" / "object.json").unlink()
    assert ids_digest(capture) == "", "a folder of that name of any other origin"


def test_files_of_any_name_are_digested_and_unreadable_ones_are_told(tmp_path: Path) -> None:
    nested(tmp_path / "a")
    before = digest(tmp_path / "a")
    (tmp_path / "a" / "masks").mkdir()
    os.close(os.open(os.fsencode(tmp_path / "a") + b"/masks/notes\xe9.txt", os.O_CREAT))
    assert digest(tmp_path / "a") != before
    (tmp_path / "a" / "images" / "left" / "0.png").unlink()
    (tmp_path / "a" / "images" / "left" / "0.png").symlink_to("/proc/self/mem")  # an I/O error
    with pytest.raises(InputError, match="a: a file cannot be read"):
        digest(tmp_path / "a")


def test_a_video_goes_by_its_bytes(tmp_path: Path) -> None:
    for name, content in (("a.mp4", b"one"), ("b.mp4", b"one"), ("c.mp4", b"two")):
        (tmp_path / name).write_bytes(content)
    assert digest(tmp_path / "a.mp4") == digest(tmp_path / "b.mp4", kind="video")
    assert digest(tmp_path / "a.mp4") != digest(tmp_path / "c.mp4")


def test_a_capture_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere: expected a folder of photos"):
        digest(tmp_path / "nowhere")


def test_what_systems_and_tools_leave_beside_photos_does_not_count(tmp_path: Path) -> None:
    nested(tmp_path / "a")
    (tmp_path / "a" / "masks" / "left").mkdir(parents=True)
    shutil.copytree(tmp_path / "a" / "masks", tmp_path / "own")
    before = digest(tmp_path / "a", masks=tmp_path / "own")
    for folder in ("a", "a/images", "a/masks", "a/masks/left", "own", "own/left"):
        for name in (".DS_Store", "Thumbs.db", "a.xmp", "a.jpg.supplemental-metadata.json"):
            (tmp_path / folder / name).write_bytes(b"x")
    (tmp_path / "a" / "database.db").write_bytes(b"COLMAP's, written anew when it is opened")
    assert digest(tmp_path / "a", masks=tmp_path / "own") == before
