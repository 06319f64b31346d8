"""Crops along outlines: photo and mask stay together, and a batch follows from seed and step."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.segment.outline.crops import batch, cut, load_pairs

SIZE = 32


def folder_of(path: Path, colours: list[int]) -> Path:
    """Images whose object, a square, is of a grey, on black."""
    for name in ("images", "masks"):
        (path / name).mkdir(parents=True)
    for k, grey in enumerate(colours):
        mask = np.zeros((80, 100), np.uint8)
        mask[20:60, 30:70] = 255
        cv2.imwrite(str(path / "masks" / f"{k}.png"), mask)
        cv2.imwrite(
            str(path / "images" / f"{k}.png"), np.repeat(mask[..., None] // 255 * grey, 3, 2)
        )
    return path


def test_a_crop_shows_photo_and_mask_of_the_same_place(tmp_path: Path) -> None:
    (pair,) = load_pairs(folder_of(tmp_path, [255]))
    for seed in range(20):
        image, mask = cut(np.random.default_rng(seed), pair, SIZE)
        assert image.shape == (SIZE, SIZE, 3)
        assert np.abs(image[..., 0].astype(int) - mask).max() <= 1
        assert 0 < (mask > 127).mean() < 1


def test_a_batch_follows_from_seed_and_step_and_takes_folders_alike(tmp_path: Path) -> None:
    few = load_pairs(folder_of(tmp_path / "few", [60]))
    many = load_pairs(folder_of(tmp_path / "many", [250] * 9))
    first, again = batch([few, many], 1, 2, SIZE, 40), batch([few, many], 1, 2, SIZE, 40)
    for one, other in zip(first, again, strict=True):
        assert one.shape[0] == 40
        assert np.array_equal(one, other)
    assert not np.array_equal(first[0], batch([few, many], 1, 3, SIZE, 40)[0])
    bright = [_inside(photo[:3], truth[0]) > 0.5 for photo, truth in zip(*first[:2], strict=True)]
    assert 10 <= sum(bright) <= 30  # of nine in ten images, if each image had the same share


def _inside(photo: NDArray[np.float32], truth: NDArray[np.float32]) -> float:
    return float(photo[:, truth > 0.9].mean()) if (truth > 0.9).any() else 0.0


def test_errors_count_near_outlines(tmp_path: Path) -> None:
    pairs = load_pairs(folder_of(tmp_path, [255]))
    _, truths, weights = batch([pairs], 0, 0, 64, 4)
    edges = np.abs(np.diff(truths[:, 0], axis=2)) > 0.5
    assert (weights[:, 0, :, 1:][edges] == 1).all()
    assert weights.min() == pytest.approx(0.1)


def test_folders_without_images_and_broken_pairs_are_named(tmp_path: Path) -> None:
    (tmp_path / "none" / "images").mkdir(parents=True)
    with pytest.raises(InputError, match=r"none.images: expected .* with an object .* none"):
        load_pairs(tmp_path / "none")
    broken = folder_of(tmp_path / "broken", [200])
    cv2.imwrite(str(broken / "masks" / "0.png"), np.zeros((4, 4), np.uint8))
    with pytest.raises(InputError, match=r"0\.png: expected an image, and in masks/ a mask"):
        load_pairs(broken)
