"""Files that are no photos are named with what to do, or passed over where they say nothing new."""

from pathlib import Path

import pytest
from PIL import Image

from mattgs_ops.capture.formats.not_read import advice
from mattgs_ops.capture.photos import list_photos


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("IMG_1.HEIC", " (this format is not read: convert it to JPEG)"),
        ("a.nef", " (raw files are not read: develop them to JPEG)"),
        ("walk.MOV", " (give a video as --video FILE)"),
        ("transforms_val.json", " (give NeRF's own layout as --capture FOLDER)"),
        ("notes.txt", ""),
    ],
)
def test_advice_is_for_formats_that_people_try(name: str, says: str) -> None:
    assert advice(name) == says


def test_nerfs_lists_among_photos_are_passed_over(tmp_path: Path) -> None:
    """Tools write them there; in NeRF's own layout, where they list folders, they are named."""
    photo = Image.new("RGB", (8, 8))
    for folder in ("images", "nerf/train"):
        (tmp_path / folder).mkdir(parents=True)
        photo.save(tmp_path / folder / "r_0.png")
    for folder in ("images", "nerf"):
        (tmp_path / folder / "transforms_train.json").write_text("{}", encoding="utf-8")
    photos, problems = list_photos(tmp_path / "images")
    assert ([path.name for path in photos], problems) == (["r_0.png"], [])
    [problem] = list_photos(tmp_path / "nerf")[1]
    assert problem.endswith("another folder (give NeRF's own layout as --capture FOLDER)")
