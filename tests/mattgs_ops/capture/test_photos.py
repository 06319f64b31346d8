"""Photos on disk: what is accepted, what is refused, and that decoding keeps the pixels."""

import os
import shutil
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from mattgs_ops.capture.photos import (
    Photo,
    decode,
    exif_orientation,
    list_photos,
    mark_output,
    on_white,
    perhaps_cropped,
    read_rgb,
    write_png,
)
from mattgs_ops.errors import InputError, StageError
from tests.mattgs_ops.capture.conftest import picture, run

ORIENTATION = 0x0112


def colours(height: int = 24, width: int = 32, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as error:
        decode(path)
    assert str(path) in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("suffix", ["png", "tiff", "webp", "bmp"])
def test_lossless_formats_decode_to_their_pixels(tmp_path: Path, suffix: str) -> None:
    rgb = colours()
    Image.fromarray(rgb).save(tmp_path / f"a.{suffix}", lossless=True)  # of WebP alone
    photo = decode(tmp_path / f"a.{suffix}")
    np.testing.assert_array_equal(photo.rgb, rgb)
    assert photo.alpha is None
    assert photo.size == (32, 24)


# EXIF 2.32: value → how the stored pixels must be turned to stand upright
UPRIGHT = {
    1: lambda a: a,
    2: np.fliplr,
    3: lambda a: np.rot90(a, 2),
    4: np.flipud,
    5: lambda a: a.transpose(1, 0, 2),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: np.rot90(a, 2).transpose(1, 0, 2),
    8: lambda a: np.rot90(a, 1),
}


@pytest.mark.parametrize("orientation", UPRIGHT)
def test_exif_orientation_is_baked_into_the_pixels(tmp_path: Path, orientation: int) -> None:
    rgb = colours()
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    Image.fromarray(rgb).save(tmp_path / "a.png", exif=exif)
    np.testing.assert_array_equal(decode(tmp_path / "a.png").rgb, UPRIGHT[orientation](rgb))
    assert exif_orientation(tmp_path / "a.png") == orientation


@pytest.mark.parametrize("tag", [ExifTags.Base.XResolution, ExifTags.Base.ImageWidth])
def test_a_turned_photo_with_a_tag_of_the_wrong_type_is_read(tmp_path: Path, tag: int) -> None:
    """A number stored as text: Pillow reads it, and cannot write it again."""
    entries = [(ORIENTATION, 3, 1, struct.pack("<HH", 6, 0)), (tag, 2, 4, b"72 \0")]
    table = b"".join(struct.pack("<HHI", *entry) + value for *entry, value in sorted(entries))
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, len(entries)) + table + bytes(4)
    rgb = colours()
    Image.fromarray(rgb).save(tmp_path / "a.jpg", exif=exif, quality=100, subsampling=0)
    found = decode(tmp_path / "a.jpg").rgb.astype(int)
    assert np.abs(found - np.rot90(rgb, -1)).mean() < 3


@pytest.mark.parametrize("suffix", ["png", "jpg", "tiff"])
def test_grey_photos_are_refused(tmp_path: Path, suffix: str) -> None:
    Image.fromarray(colours()[..., 0]).save(tmp_path / f"a.{suffix}")
    assert "grey photo" in refusal(tmp_path / f"a.{suffix}")


def test_grey_photos_stored_as_colour_are_refused(tmp_path: Path) -> None:
    Image.fromarray(colours()[..., 0]).convert("RGB").save(tmp_path / "a.png")
    assert "grey photo" in refusal(tmp_path / "a.png")


def test_sixteen_bit_grey_is_refused(tmp_path: Path) -> None:
    Image.fromarray(colours()[..., 0].astype(np.uint16) * 257).save(tmp_path / "a.png")
    assert "16 bits" in refusal(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", ["png", "tiff"])
def test_sixteen_bit_colour_is_refused_though_pillow_opens_it(tmp_path: Path, suffix: str) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / f"a.{suffix}"
    assert cv2.imwrite(str(path), colours().astype(np.uint16) * 257)
    assert "16 bits" in refusal(path)


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tiff"])
def test_photos_cut_short_are_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(colours(120, 160)).save(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    message = refusal(path)
    assert "damaged or cut short" in message or "cannot be read" in message


def test_a_photo_beyond_what_is_read_is_not_called_damaged(tmp_path: Path) -> None:
    """The header alone tells the size; 200 megapixels are what some phones take."""
    path = tmp_path / "a.png"
    Image.fromarray(colours()).save(path)
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 16320, 12240)  # IHDR's width and height
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    path.write_bytes(bytes(data))
    assert "too large to be read (Image size (199756800 pixels)" in refusal(path)


def test_text_called_jpg_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_text("not a picture")
    assert "cannot be read as an image" in refusal(tmp_path / "a.jpg")


def test_cmyk_and_animations_are_refused(tmp_path: Path) -> None:
    Image.fromarray(colours()).convert("CMYK").save(tmp_path / "a.jpg")
    assert "CMYK" in refusal(tmp_path / "a.jpg")
    frames = [Image.fromarray(colours(seed=seed)) for seed in (0, 1)]
    frames[0].save(tmp_path / "b.tiff", save_all=True, append_images=frames[1:])
    assert "holds 2 pictures" in refusal(tmp_path / "b.tiff")


def test_alpha_is_straight_and_composited_on_white(tmp_path: Path) -> None:
    rgba = np.dstack([colours(), colours()[..., 0]])
    Image.fromarray(rgba).save(tmp_path / "a.png")
    photo = decode(tmp_path / "a.png")
    assert photo.alpha is not None
    np.testing.assert_array_equal(photo.alpha, rgba[..., 3])
    share = rgba[..., 3:] / 255
    expected = share * rgba[..., :3] + (1 - share) * 255
    assert np.abs(on_white(photo) - expected).max() <= 0.5 + 1e-9


def test_opaque_alpha_counts_as_none(tmp_path: Path) -> None:
    rgba = np.dstack([colours(), np.full((24, 32), 255, np.uint8)])
    Image.fromarray(rgba).save(tmp_path / "a.png")
    assert decode(tmp_path / "a.png").alpha is None


def test_on_white_leaves_opaque_photos_alone() -> None:
    rgb = colours()
    assert on_white(Photo(rgb, None)) is rgb


def test_listing_sorts_by_name_and_passes_over_what_systems_and_tools_leave(tmp_path: Path) -> None:
    for name in ("b.jpg", "a.png", "C.JPG"):
        Image.fromarray(colours()).save(tmp_path / name)
    for name in (".DS_Store", "Thumbs.db", "transforms.json", "C.AAE", "a.xmp", "b.jpg.json"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "masks").mkdir()
    photos, problems = list_photos(tmp_path)
    assert [path.name for path in photos] == ["C.JPG", "a.png", "b.jpg"]
    assert problems == []


def test_listing_sorts_numbers_by_their_value(tmp_path: Path) -> None:
    for name in ("frame10.jpg", "frame9.jpg", "frame100.jpg", "frame0.jpg"):
        Image.fromarray(colours()).save(tmp_path / name)
    photos, _ = list_photos(tmp_path)
    names = ["frame0.jpg", "frame9.jpg", "frame10.jpg", "frame100.jpg"]
    assert [path.name for path in photos] == names


def test_frames_with_plain_numbers_keep_their_order_and_an_even_split(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    for number in range(12):
        Image.fromarray(picture(number)).save(folder / f"{number}.png")
    capture = run(folder, tmp_path / "out")
    assert [view.name for view in capture.views] == [f"{number}.png" for number in range(12)]
    assert [v.name for v in capture.views if v.split == "test"] == ["0.png", "4.png", "8.png"]


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("notes.txt", "not an image; remove it or move it"),
        ("IMG_1.HEIC", "convert it to JPEG"),
        ("walk.mov", "give a video as --video FILE"),
        ("IMG_1.dng", "develop them"),
    ],
)
def test_files_that_are_no_photos_are_named(tmp_path: Path, name: str, advice: str) -> None:
    (tmp_path / name).write_bytes(b"something else")
    _, problems = list_photos(tmp_path)
    assert len(problems) == 1
    assert str(tmp_path / name) in problems[0]
    assert advice in problems[0]


@pytest.mark.parametrize(
    ("name", "what"),
    [(b"caf\xe9.jpg", "is not UTF-8"), (b"a" * 247 + b".jpeg", "is 252 bytes long")],
)
def test_names_that_stages_cannot_use_are_told(tmp_path: Path, name: bytes, what: str) -> None:
    Image.fromarray(colours()).save(tmp_path / "a.jpg")
    shutil.copyfile(tmp_path / "a.jpg", os.fsencode(tmp_path) + b"/" + name)
    photos, problems = list_photos(tmp_path)
    assert photos == [tmp_path / "a.jpg"]
    assert what in problems[0]


def test_our_own_output_among_the_photos_holds_none(tmp_path: Path) -> None:
    Image.fromarray(colours()).save(tmp_path / "a.png")
    out = tmp_path / "mattgs-out"
    mark_output(out)
    (out / "run.json").write_text("{}")
    Image.fromarray(colours()).save(out / "render.png")
    assert list_photos(tmp_path) == ([tmp_path / "a.png"], [])


def test_folders_are_read_and_their_links_do_not_go_in_circles(tmp_path: Path) -> None:
    (tmp_path / "near" / "closer").mkdir(parents=True)
    (tmp_path / "own").mkdir()
    for name in ("b.png", "near/a.png", "near/closer/a.png", "own/m.png", "near/.cache.png"):
        Image.fromarray(colours()).save(tmp_path / name)
    (tmp_path / "near" / "back").symlink_to(tmp_path)
    (tmp_path / "near" / "notes.txt").write_text("x")
    photos, problems = list_photos(tmp_path, masks=tmp_path / "own")
    found = [path.relative_to(tmp_path).as_posix() for path in photos]
    assert found == ["b.png", "near/a.png", "near/closer/a.png"]
    assert [problem.split(":")[0] for problem in problems] == [str(tmp_path / "near" / "notes.txt")]


def test_a_photo_without_suffix_is_found_by_its_content(tmp_path: Path) -> None:
    Image.fromarray(colours()).save(tmp_path / "photo", format="PNG")
    assert [path.name for path in list_photos(tmp_path)[0]] == ["photo"]


def test_a_stage_s_photo_is_read_as_red_green_blue(tmp_path: Path) -> None:
    rgb = colours()
    Image.fromarray(rgb).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_rgb(tmp_path / "a.png"), rgb)
    (tmp_path / "b.png").write_text("none")
    for name in ("b.png", "missing.png"):
        with pytest.raises(InputError, match=rf"{name}: expected a readable photo"):
            read_rgb(tmp_path / name)


def test_what_is_written_is_read_by_any_program_as_it_was(tmp_path: Path) -> None:
    rgb, mask = colours(), colours()[..., 0]
    for name, pixels in (("photo.png", rgb), ("mask.png", mask)):
        write_png(tmp_path / "new" / name, pixels)
        with Image.open(tmp_path / "new" / name) as stored:
            np.testing.assert_array_equal(np.asarray(stored), pixels)
    (tmp_path / "taken.png").mkdir()
    with pytest.raises(StageError, match=r"taken\.png: could not be written: Is a directory"):
        write_png(tmp_path / "taken.png", mask)


def test_a_full_disk_is_the_reason_why_a_photo_could_not_be_written(tmp_path: Path) -> None:
    (tmp_path / "a.png").symlink_to("/dev/full")
    with pytest.raises(StageError, match=r"a\.png: could not be written: No space left"):
        write_png(tmp_path / "a.png", colours())


def test_photos_of_a_size_of_their_own_may_be_cropped() -> None:
    sizes = {"a": (40, 30), "b": (30, 40), "c": (40, 29), "d": (40, 30)}
    (told,) = perhaps_cropped(sizes)
    assert told.startswith("1 have a size that no other photo has: c; if they are cropped")
    assert perhaps_cropped(sizes | {"c": (40, 30)}) == []
    assert perhaps_cropped(sizes, mended=["c"]) == []
