"""Captures that cannot be used are refused by name, with what was expected and found."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.mattgs_ops.capture.conftest import (
    HEIGHT,
    NAMES,
    WIDTH,
    disc,
    picture,
    pixels,
    refusal,
    run,
    write_cutouts,
    write_masks,
    write_photos,
    write_transforms,
)


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    assert "nowhere: expected a folder of photos" in refusal(tmp_path / "nowhere", tmp_path / "o")
    (tmp_path / "file").write_text("")
    assert "found a file" in refusal(tmp_path / "file", tmp_path / "o")
    folder = write_photos(tmp_path / "in")
    assert "folder of masks" in refusal(folder, tmp_path / "o", masks=tmp_path / "no")


def test_a_file_of_cameras_of_another_name(tmp_path: Path) -> None:
    file = tmp_path / "my_transforms.json"
    file.write_text("{}")
    message = refusal(file, tmp_path / "out")
    assert f"{file}: expected a folder of photos, found a file; if it lists cameras" in message


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_photos(tmp_path: Path, count: int) -> None:
    folder = write_photos(tmp_path / "in", NAMES[:count])
    message = refusal(folder, tmp_path / "out")
    assert f"found {count} photos; at least 3 are needed" in message
    assert str(folder) in message


def test_three_photos_are_enough_to_begin(tmp_path: Path) -> None:
    assert len(run(write_photos(tmp_path / "in", NAMES[:3]), tmp_path / "out").views) == 3


def test_all_problems_are_named_at_once(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    Image.fromarray(picture(1)[..., 0]).save(folder / NAMES[1])
    Image.fromarray(picture(2)[..., 0].astype(np.uint16) * 257).save(folder / NAMES[2])
    (folder / NAMES[3]).write_bytes((folder / NAMES[3]).read_bytes()[:500])
    (folder / NAMES[4]).write_bytes(b"")
    lines = refusal(folder, tmp_path / "out").splitlines()
    expected = {
        NAMES[1]: "grey photo",
        NAMES[2]: "16 bits per channel",
        NAMES[3]: "damaged or cut short",
        NAMES[4]: "cannot be read as an image",
    }
    assert len(lines) == len(expected)
    for line, (name, problem) in zip(lines, expected.items(), strict=True):
        assert str(folder / name) in line
        assert problem in line


def test_a_file_that_is_no_photo(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    (folder / "notes.txt").write_text("x")
    message = refusal(folder, tmp_path / "out")
    assert f"{folder / 'notes.txt'}: not an image; remove it" in message


def test_two_photos_of_one_name_are_refused(tmp_path: Path) -> None:
    write_photos(tmp_path / "in" / "left", NAMES[:3])
    write_photos(tmp_path / "in", [f"left__{NAMES[1]}"])
    message = refusal(tmp_path / "in", tmp_path / "out")
    assert f"both would be called left__{NAMES[1]}; rename one" in message


def test_photos_beside_the_images_folder(tmp_path: Path) -> None:
    write_photos(tmp_path / "in" / "images")
    write_photos(tmp_path / "in", ["extra.png"])
    assert "extra.png: 1 photos lie beside" in refusal(tmp_path / "in", tmp_path / "out")


def test_masks_upside_down(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    write_masks(folder / "masks", 255 - disc())
    assert "10 of 10 masks look inverted" in refusal(folder, tmp_path / "out")


def test_masks_missing_or_of_another_size(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    write_masks(folder / "masks", disc())
    (folder / "masks" / f"{NAMES[7]}.png").unlink()
    Image.fromarray(disc()[::2, ::2]).save(folder / "masks" / f"{NAMES[8]}.png")
    message = refusal(folder, tmp_path / "out")
    assert f"no mask for {NAMES[7]}" in message
    assert f"{NAMES[8]}.png: the mask is 24x18, its photo 48x36" in message


@pytest.mark.parametrize("form", ["{name}.png", "{stem}_mask.jpg"])
def test_masks_among_the_photos(tmp_path: Path, form: str) -> None:
    """They would be photos of a white shape on black."""
    folder = write_photos(tmp_path / "in")
    write_masks(folder, disc(), form)
    message = refusal(folder, tmp_path / "out")
    first = folder / form.format(name=NAMES[0], stem=Path(NAMES[0]).stem)
    assert f"{first}: called like the mask of {NAMES[0]}; so are 9 more; move masks to" in message


def test_masks_that_serve_photos_of_two_folders_or_lie_within_one(tmp_path: Path) -> None:
    """One mask for two photos would be wrong for one of them, and nobody would know."""
    for side in ("left", "right"):
        write_photos(tmp_path / "in" / side)
    write_masks(tmp_path / "in" / "masks", disc())
    message = refusal(tmp_path / "in", tmp_path / "out")
    assert f"no mask for left/{NAMES[0]} and 19 more photos" in message
    shutil.rmtree(tmp_path / "in" / "masks")
    write_masks(tmp_path / "in" / "left" / "masks", disc())
    message = refusal(tmp_path / "in", tmp_path / "out")
    assert "left/masks: masks in a folder of photos are not found; move them to" in message


def test_all_white_masks_are_named_together(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in")
    write_masks(folder / "masks", disc())
    for name in NAMES[3:5]:
        Image.fromarray(np.full_like(disc(), 255)).save(folder / "masks" / f"{name}.png")
    message = refusal(folder, tmp_path / "out")
    for name in NAMES[3:5]:
        assert f"{name}: its mask is white all over" in message


def test_transparency_in_some_photos_only(tmp_path: Path) -> None:
    write_cutouts(tmp_path / "in")
    Image.fromarray(picture(9)).save(tmp_path / "in" / NAMES[9])
    message = refusal(tmp_path / "in", tmp_path / "out")
    assert f"{NAMES[9]}: 1 of 10 photos have no mask or transparency" in message


def test_intrinsics_of_other_photos(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "in", w=2 * WIDTH, h=2 * HEIGHT)
    assert "the photo is 48x36, its camera says 96x72" in refusal(folder, tmp_path / "out")


def test_exif_orientation_with_a_given_camera_is_ambiguous(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "in")
    exif = Image.Exif()
    exif[0x0112] = 3  # upside down: the size does not tell which way up the pose is
    Image.fromarray(picture(0)).save(folder / "images" / NAMES[0], exif=exif)
    assert f"{NAMES[0]}: turned by its EXIF orientation" in refusal(folder, tmp_path / "out")


def test_exif_orientation_is_clear_where_the_cameras_size_tells_it(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "in")
    exif = Image.Exif()
    exif[0x0112] = 6
    sideways = Image.fromarray(np.ascontiguousarray(np.rot90(picture(0))))
    sideways.save(folder / "images" / NAMES[0], exif=exif)
    view = run(folder, tmp_path / "out").views[0]
    np.testing.assert_array_equal(pixels(view.photo), picture(0))


def test_a_photo_whose_camera_is_of_the_stored_pixels_is_not_turned(tmp_path: Path) -> None:
    """As COLMAP leaves it: it does not turn the photos that a phone took on its side."""
    folder = write_transforms(tmp_path / "in")
    exif = Image.Exif()
    exif[0x0112] = 6
    for seed, name in enumerate(NAMES):
        Image.fromarray(picture(seed)).save(folder / "images" / name, exif=exif)
        (folder / "masks").mkdir(exist_ok=True)
        Image.fromarray(disc()).save(folder / "masks" / f"{name}.png")
    view = run(folder, tmp_path / "out").views[0]
    np.testing.assert_array_equal(pixels(view.photo), picture(0))
    np.testing.assert_array_equal(pixels(view.mask), disc())


def test_threads_change_no_byte_and_keep_the_order_of_problems(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "photos")
    for threads in (1, 3):
        run(folder, tmp_path / str(threads), threads=threads)
    one, three = (
        {path.relative_to(out): path.read_bytes() for path in out.rglob("*") if path.is_file()}
        for out in (tmp_path / "1", tmp_path / "3")
    )
    assert one == three
    for name in (NAMES[7], NAMES[2]):
        (folder / name).write_bytes(b"no photo")
    told = [refusal(folder, tmp_path / "out", threads=threads) for threads in (1, 3)]
    assert told[0] == told[1]
    assert told[0].index(NAMES[2]) < told[0].index(NAMES[7])
