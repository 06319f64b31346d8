"""Specification of what is refused before any key point is sought."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops import sfm
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError
from mattgs_ops.sfm.checks import check, check_given_cameras

Copy = Callable[..., PreparedCapture]


def masks_of(capture: PreparedCapture) -> Path:
    return capture.folder / "masks"


def test_sound_input_passes_and_empty_masks_are_named(copied: Copy) -> None:
    capture = copied()
    assert check(capture, masks_of(capture)) == []
    black = np.zeros((capture.views[3].height, capture.views[3].width), np.uint8)
    cv2.imwrite(str(masks_of(capture) / "0003.jpg.png"), black)
    assert check(capture, masks_of(capture)) == ["0003.jpg"]


def test_a_missing_mask_is_named(copied: Copy) -> None:
    capture = copied()
    (masks_of(capture) / "0002.jpg.png").unlink()
    with pytest.raises(InputError, match=r"0002\.jpg\.png: expected the mask of 0002\.jpg"):
        check(capture, masks_of(capture))


def test_cameras_of_too_few_photos_are_refused_before_any_work(
    copied: Copy, tmp_path: Path
) -> None:
    capture = copied()
    posed = [replace(view, camera=None) for view in capture.views[4:]]
    few = replace(capture, cameras_are="given", views=(*capture.views[:4], *posed))
    with pytest.raises(InputError, match="expected cameras of at least 50%") as error:
        sfm.reconstruct(few, masks_of(few), SfmConfig(), tmp_path / "scene")
    assert f"found 4 of {len(few.views)}; without one: {few.views[4].name}, " in str(error.value)
    assert not (tmp_path / "scene").exists()
    check_given_cameras(few, 4 / len(few.views))


def damage_half_size(path: Path) -> None:
    mask = np.array(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    cv2.imwrite(str(path), mask[::2, ::2])


def damage_grey_values(path: Path) -> None:
    mask = np.array(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    mask[5, 5] = 1  # COLMAP takes anything but 0 for the object
    cv2.imwrite(str(path), mask)


def damage_text(path: Path) -> None:
    path.write_text("no image")


def damage_colour(path: Path) -> None:
    cv2.imwrite(str(path), np.zeros((180, 240, 3), np.uint8))


def damage_depth(path: Path) -> None:
    cv2.imwrite(str(path), np.full((180, 240), 65535, np.uint16))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (damage_half_size, "expected the photo's size 240x180, found 120x90"),
        (damage_grey_values, "expected only 0 and 255, found 1"),
        (damage_text, "expected an 8-bit grey mask, found no readable image"),
        (damage_colour, r"expected an 8-bit grey mask, found uint8 \(180, 240, 3\)"),
        (damage_depth, r"expected an 8-bit grey mask, found uint16"),
    ],
)
def test_masks_that_colmap_would_misread_are_refused(
    copied: Copy, damage: Callable[[Path], None], message: str
) -> None:
    capture = copied()
    damage(masks_of(capture) / "0004.jpg.png")
    with pytest.raises(InputError, match=rf"0004\.jpg\.png: {message}"):
        check(capture, masks_of(capture))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (damage_text, "expected an 8-bit RGB photo, found no readable image"),
        (damage_depth, "expected an 8-bit RGB photo, found uint16"),
        (damage_half_size, r"expected an 8-bit RGB photo, found uint8 \(90, 120\)"),
        (Path.unlink, "expected an 8-bit RGB photo, found no readable image"),
        (
            lambda path: cv2.imwrite(str(path), np.zeros((90, 120, 3), np.uint8)),
            "expected 240x180 pixels, found 120x90",
        ),
    ],
)
def test_photos_that_colmap_would_skip_are_refused(
    copied: Copy, damage: Callable[[Path], None], message: str
) -> None:
    capture = copied()
    damage(capture.views[1].photo)
    with pytest.raises(InputError, match=rf"0001\.jpg\.png: {message}"):
        check(capture, masks_of(capture))


@pytest.mark.parametrize("threads", [1, 3])
def test_all_problems_are_told_at_once_up_to_five(copied: Copy, threads: int) -> None:
    capture = copied()
    for k in range(7):
        (masks_of(capture) / f"000{k}.jpg.png").unlink()
    with pytest.raises(InputError) as error:
        check(capture, masks_of(capture), threads=threads)
    lines = str(error.value).splitlines()
    assert [f"000{k}.jpg" in line for k, line in enumerate(lines)] == [True] * 5 + [False]
    assert lines[5] == "… and 2 more"


def test_black_masks_and_single_photos_end_before_any_work(copied: Copy, tmp_path: Path) -> None:
    capture = copied()
    for view in capture.views:
        cv2.imwrite(str(masks_of(capture) / f"{view.name}.png"), np.zeros((180, 240), np.uint8))
    with pytest.raises(InputError, match="all 9 masks are black"):
        sfm.reconstruct(capture, masks_of(capture), SfmConfig(), tmp_path / "out")
    few = replace(capture, views=capture.views[:2])
    with pytest.raises(InputError, match="expected at least 3 photos, found 2"):
        sfm.reconstruct(few, masks_of(capture), SfmConfig(), tmp_path / "out")
    assert not (tmp_path / "out").exists()
