"""Masks and id maps beside photos: naming, polarity, and what cannot be a mask."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from mattgs_ops.capture.mask_files import (
    decode_mask,
    find_mask,
    looks_inverted,
    missing_masks,
    polarity_problem,
)
from mattgs_ops.capture.prepare import prepare
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError
from tests.mattgs_ops.capture.conftest import NAMES, run, write_transforms

SIZE = (30, 20)


def disc() -> np.ndarray:
    y, x = np.mgrid[:20, :30]
    return np.where((x - 15) ** 2 + (y - 10) ** 2 < 64, 255, 0).astype(np.uint8)


def saved(folder: Path, values: np.ndarray, name: str = "a.jpg.png") -> Path:
    Image.fromarray(values).save(folder / name)
    return folder / name


@pytest.mark.parametrize(
    "name", ["IMG_1.JPG.png", "IMG_1.png", "IMG_1.JPG", "IMG_1.jpg", "IMG_1_mask.png"]
)
def test_every_naming_is_found(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path, disc(), name)
    assert find_mask(tmp_path, "IMG_1.JPG") == path


def test_masks_exported_by_metashape_are_found(tmp_path: Path) -> None:
    path = saved(tmp_path, disc(), "IMG_1_mask.jpg")
    assert find_mask(tmp_path, "IMG_1.JPG") == path


def test_the_whole_name_goes_before_the_stem(tmp_path: Path) -> None:
    saved(tmp_path, disc(), "a.png")
    whole = saved(tmp_path, disc(), "a.jpg.png")
    assert find_mask(tmp_path, "a.jpg") == whole


def test_a_missing_mask_names_what_to_add(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no mask for IMG_1\.jpg; add IMG_1\.jpg\.png or IMG_1"):
        find_mask(tmp_path, "IMG_1.jpg")


def test_photos_without_masks_are_told_in_one_line(tmp_path: Path) -> None:
    said = missing_masks(tmp_path, ["a/1.jpg", "a/2.jpg", "a/3.jpg"])
    assert said == (
        f"{tmp_path}: no mask for a/1.jpg and 2 more photos; add a/1.jpg.png or a/1.png, and so on"
    )


def test_a_mask_is_turned_as_its_exif_asks_for(tmp_path: Path) -> None:
    """A photo and its mask that a program has turned alike stay on each other."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.fromarray(disc()).save(tmp_path / "a.png", exif=exif)
    turned = decode_mask(tmp_path / "a.png", SIZE[::-1])
    np.testing.assert_array_equal(turned, np.rot90(disc(), -1))


def test_masks_are_thresholded_at_half(tmp_path: Path) -> None:
    values = disc()
    values[10, 14], values[10, 15] = 127, 128
    mask = decode_mask(saved(tmp_path, values), SIZE)
    assert set(np.unique(mask)) == {0, 255}
    assert (mask[10, 14], mask[10, 15]) == (0, 255)


def test_one_bit_and_grey_rgb_masks_are_read(tmp_path: Path) -> None:
    Image.fromarray(disc()).convert("1").save(tmp_path / "a.png")
    Image.fromarray(disc()).convert("RGB").save(tmp_path / "b.png")
    for name in ("a.png", "b.png"):
        np.testing.assert_array_equal(decode_mask(tmp_path / name, SIZE), disc())


@pytest.mark.parametrize(("tinted", "read"), [(1, True), (120, True), (121, False)])
def test_a_few_pixels_may_be_tinted_as_jpeg_does_along_outlines(
    tmp_path: Path, tinted: int, read: bool
) -> None:
    """Up to 0.002 of them: more could be an object."""
    grey = np.repeat(np.repeat(disc(), 10, axis=0), 10, axis=1)
    values = np.dstack([grey] * 3)
    values.reshape(-1, 3)[:tinted] = [140, 120, 120]
    path = saved(tmp_path, values)
    with nullcontext() if read else pytest.raises(InputError, match="coloured"):
        np.testing.assert_array_equal(decode_mask(path), grey)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (disc() // 255, "holds 0 and 1"),
        (disc() * 0, "empty"),
        (disc()[:10], "mask is 30x10, its photo 30x20"),
        (disc().astype(np.uint16) * 257, "more than 8 bits"),
        (np.dstack([disc(), disc(), disc() * 0]), "coloured"),
        (np.dstack([disc(), disc(), disc(), disc()]), "alpha channel is ambiguous"),
    ],
)
def test_what_cannot_be_a_mask_is_refused(tmp_path: Path, values: np.ndarray, message: str) -> None:
    path = saved(tmp_path, values)
    with pytest.raises(InputError, match=message) as error:
        decode_mask(path, SIZE)
    assert str(path) in str(error.value)


def test_text_called_png_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("x")
    with pytest.raises(InputError, match="cannot be read as a mask"):
        decode_mask(tmp_path / "a.png", SIZE)


def test_polarity_is_recognised() -> None:
    assert not looks_inverted(disc())
    assert looks_inverted(255 - disc())
    assert not looks_inverted(np.full((20, 30), 255, np.uint8))  # a close-up fills the frame


def test_a_set_is_judged_as_a_whole() -> None:
    assert polarity_problem({}) is None
    assert polarity_problem({"a": True, "b": False}) is None
    message = polarity_problem({"a": True, "b": True, "c": False})
    assert message is not None
    assert "2 of 3 masks look inverted, for example a" in message
    assert "255 = object" in message


def test_bundled_captures_know_the_small_structures_of_test_views(tmp_path: Path) -> None:
    prepared = prepare(CaptureConfig(name="rover"), tmp_path / "out", test_every=8)
    for view in prepared.views:
        assert (view.ids is not None) == (view.split == "test")
        if view.ids is not None:
            ids = np.asarray(Image.open(view.ids))
            assert ids.shape == (view.height, view.width)
            assert set(np.unique(ids)) <= {0, 1, 2, 3}


def test_small_structures_of_a_rendered_capture_are_known_under_any_name(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "in")
    (folder / "ids").mkdir()
    height, width = np.asarray(Image.open(run(folder, tmp_path / "out").views[0].photo)).shape[:2]
    Image.fromarray(np.ones((height, width), np.uint8)).save(folder / "ids" / f"{NAMES[0]}.png")
    assert {view.ids for view in run(folder, tmp_path / "no").views} == {None}  # of unknown origin
    (folder / "object.json").write_text("{}")
    known = [view.name for view in run(folder, tmp_path / "yes").views if view.ids is not None]
    assert known == [NAMES[0]]
