"""Specification of which key points are kept, and when more are sought."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError
from mattgs_ops.sfm.colmap import features
from mattgs_ops.sfm.colmap.features import Features


def select(inside: list[bool], scales: list[float], limit: int) -> Features:
    """Return the chosen ones of some key points, whose x tells them apart."""
    keypoints = np.zeros((len(scales), 4), np.float32)
    keypoints[:, 2] = scales
    keypoints[:, 0] = np.arange(len(scales))
    found = np.array(inside, dtype=bool)
    chosen = features.select(keypoints, found, limit)
    data = np.zeros((len(chosen.rows), 128), np.uint8)
    counts = len(found), int(found.sum())
    kept = keypoints[chosen.rows], data, found[chosen.rows]
    return Features(*kept, chosen.whole, chosen.masked, counts)


def test_photo_and_object_each_keep_their_key_points_of_largest_scale() -> None:
    kept = select([False, True, False, True, True, False], [9, 1, 5, 2, 0.5, 7], 2)
    assert kept.keypoints[:, 0].tolist() == [0, 5, 3, 1]  # largest scale first
    assert kept.whole.tolist() == [True, True, False, False]
    assert kept.masked.tolist() == [False, False, True, True]
    assert kept.inside.tolist() == [False, False, True, True]


def test_modes_see_the_sets_that_are_theirs() -> None:
    kept = select([False, True, False, True], [9, 1, 5, 6], 3)
    names = {m: kept.of_mode(m).keypoints[:, 0].tolist() for m in ("original", "masked", "shared")}
    assert names == {"original": [0, 3, 2], "masked": [3, 1], "shared": [0, 3, 2, 1]}
    masked = kept.of_mode("masked")
    assert masked.inside.all()
    assert masked.found == (4, 2)
    assert np.array_equal(masked.positions[:, 0], [3, 1])


def test_without_a_cap_the_two_sets_are_the_photo_and_its_mask() -> None:
    kept = select([False, True, True], [1, 2, 3], 99)
    assert kept.whole.all()
    assert np.array_equal(kept.masked, kept.inside)
    assert len(select([], [], 5).inside) == 0


def blobs(centres: list[tuple[float, float]], sigma: float) -> NDArray[np.uint8]:
    """Draw dark Gaussian blobs on grey, at pixels whose first one has its centre at (0.5, 0.5)."""
    y, x = np.mgrid[:120, :160] + 0.5
    image = np.full((120, 160), 0.7)
    for cx, cy in centres:
        image -= 0.5 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * sigma**2))
    return np.rint(image * 255).astype(np.uint8)


def described(
    image: NDArray[np.uint8], tmp_path: Path, scale: float = 1, limit: int = 99
) -> Features:
    mask = np.zeros([round(side * scale) for side in image.shape], np.uint8)
    mask[:, : mask.shape[1] // 2] = 255  # the left half is object
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    how = features.Extraction(0.02 / 3)
    return features.describe(image, (scale, scale), tmp_path / "mask.png", limit, how)


def test_key_points_lie_in_the_middle_of_blobs_with_their_size(tmp_path: Path) -> None:
    centres = [(40.0, 50.0), (103.3, 60.7)]
    kept = described(blobs(centres, 4.0), tmp_path)
    near = kept.keypoints[np.abs(kept.keypoints[:, 2] / 4.0 - 1) < 0.3]
    for x, y in centres:
        assert np.hypot(*(near[:, :2] - [x, y]).T).min() < 0.1  # of a pixel
    assert kept.inside.tolist() == (kept.keypoints[:, 0] < 80).tolist()
    twice = described(blobs(centres, 4.0), tmp_path, scale=2.0)
    assert np.allclose(twice.keypoints[:, :3], 2 * kept.keypoints[:, :3])


def test_only_what_is_kept_is_described_and_descriptors_have_one_length(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, (120, 160), dtype=np.uint8), (0, 0), 1.5)
    image = cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX)
    kept, all_of_them = described(image, tmp_path, limit=20), described(image, tmp_path)
    assert kept.found == all_of_them.found
    assert 20 < len(kept.descriptors) <= 40 < sum(kept.found)
    assert np.allclose(np.linalg.norm(kept.descriptors.astype(float), axis=1), 512, rtol=0.02)
    # the same but for where the pyramid of blurred photos begins: at the finest that is asked for
    likeness = kept.descriptors.astype(float) @ all_of_them.descriptors.astype(float).T / 512**2
    assert (likeness.max(axis=1) > 0.97).all()


def test_a_photo_without_texture_has_no_key_points(tmp_path: Path) -> None:
    kept = described(np.full((60, 80), 128, np.uint8), tmp_path)
    assert (kept.descriptors.shape, kept.found) == ((0, 128), (0, 0))


def test_key_points_are_inside_by_the_pixel_they_fall_on(tmp_path: Path) -> None:
    mask = np.zeros((40, 60), np.uint8)
    mask[10:20, 30:40] = 255
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    keypoints = np.zeros((5, 4), np.float32)
    keypoints[:, :2] = np.array([[30, 10], [39.99, 19.99], [40, 15], [29.9, 15], [41.5, 15]])
    inside = features.inside_mask(tmp_path / "m.png", keypoints, 0.0)
    assert inside.tolist() == [True, True, False, False, False]
    grown = features.inside_mask(tmp_path / "m.png", keypoints, 0.02)  # one pixel of 60
    assert grown.tolist() == [True, True, True, True, False]


def test_an_unreadable_mask_or_photo_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"m\.png: expected a readable mask"):
        features.inside_mask(tmp_path / "m.png", np.zeros((1, 4), np.float32), 0.0)
    with pytest.raises(InputError, match=r"p\.png: expected a readable photo"):
        features.read_grey(tmp_path / "p.png", 100)


def test_large_photos_are_shrunk_and_say_by_how_much(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.zeros((300, 400, 3), np.uint8))
    grey, scale = features.read_grey(tmp_path / "p.png", 100)
    assert (grey.shape, scale) == ((75, 100), (4.0, 4.0))
    grey, scale = features.read_grey(tmp_path / "p.png", 400)
    assert (grey.shape, scale) == ((300, 400), (1.0, 1.0))


def test_key_points_of_a_photo_whose_sides_shrink_unlike_stay_in_place(tmp_path: Path) -> None:
    """267 rows become 134: two rows are not one."""
    y, x = np.mgrid[:267, :400] + 0.5
    photo = 180 - 120 * np.exp(-((x - 300) ** 2 + (y - 240) ** 2) / (2 * 9.0**2))
    cv2.imwrite(str(tmp_path / "p.png"), np.repeat(photo[..., None], 3, axis=2).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "m.png"), np.full((267, 400), 255, np.uint8))
    grey, scale = features.read_grey(tmp_path / "p.png", 200)
    assert grey.shape == (134, 200)
    how = features.Extraction(0.02 / 3)
    kept = features.describe(grey, scale, tmp_path / "m.png", 99, how)
    assert np.hypot(*(kept.keypoints[:, :2] - [300, 240]).T).min() < 0.15


def test_more_is_sought_when_a_tenth_of_the_views_has_too_few_on_the_object() -> None:
    many = select([True] * 60, [1.0] * 60, 20)  # counted before the cap
    few = select([True] * 59 + [False] * 500, [1.0] * 559, 999)
    assert features.enough([many] * 9 + [few])
    assert not features.enough([many] * 8 + [few] * 2)


def test_the_ladder_lowers_the_threshold_then_grows_the_mask_and_says_so() -> None:
    usual, faint, grown = features.ladder(SfmConfig(peak_threshold=0.01))
    assert usual == (None, features.Extraction(0.01, 0.0))
    assert faint[1] == features.Extraction(0.0025, 0.0)
    assert grown[1] == features.Extraction(0.0025, 0.02)
    assert faint[0] == "SIFT peak threshold lowered from 0.0100 to 0.0025"
    assert grown[0] == "masks grown by 2% of the longest side for finding key points"
