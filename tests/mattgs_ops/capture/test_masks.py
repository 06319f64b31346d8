"""Cleaning, composites and mask quality, against values by hand."""

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.masks import (
    boundary_f,
    clean,
    mask_name,
    parts_apart,
    quality,
    threshold,
)


def disc(size: int, centre: tuple[int, int], radius: int) -> np.ndarray:
    return cv2.circle(np.zeros((size, size), np.uint8), centre, radius, 255, -1)


def test_threshold_takes_its_level_in() -> None:
    soft = np.array([[0.49, 0.5, 0.51]], np.float32)
    assert threshold(soft).tolist() == [[0, 255, 255]]
    assert threshold(soft, 0.505).tolist() == [[0, 0, 255]]


def test_clean_drops_specks_and_fills_pinholes_but_keeps_openings() -> None:
    mask = disc(200, (100, 100), 60)
    whole = mask.copy()
    cv2.circle(mask, (100, 100), 12, 0, -1)  # an opening, 4 % of the object
    opening = mask.copy()
    mask[70, 70] = 0  # a pinhole
    mask[5:8, 5:8] = 255  # a speck
    cleaned = clean(mask)
    assert np.array_equal(cleaned, opening)
    assert not np.array_equal(cleaned, whole)


def test_clean_keeps_a_second_large_part_and_background_at_the_border() -> None:
    mask = disc(200, (60, 100), 40) | disc(200, (150, 100), 25)
    mask[0, 0:3] = 255
    mask[0:2, 3] = 255
    cleaned = clean(mask)
    assert cleaned[100, 150] == 255
    assert cleaned[0, 0] == 0
    assert clean(np.zeros((9, 9), np.uint8)).max() == 0


def test_parts_from_two_percent_of_the_largest_stay() -> None:
    mask = np.zeros((60, 60), np.uint8)
    mask[0:10, 0:50] = mask[10:20, 0:50] = 255  # 1,000 pixels
    mask[30, 0:20] = 255
    for step in range(20):
        mask[35 + step, step] = 255  # corners touch: one part of 20 pixels
    expected = mask.copy()
    mask[30, 30:49] = 255  # 19 pixels
    assert np.array_equal(clean(mask), expected)
    assert np.array_equal(clean(expected), expected)


def test_holes_below_a_share_of_the_object_are_filled_where_they_are_closed() -> None:
    mask = np.full((100, 100), 255, np.uint8)  # holes of 5 pixels are too large, of 4 are not
    mask[10, 10:15] = mask[0, 50] = mask[99, 50] = mask[50, 0] = mask[50, 99] = 0
    expected = mask.copy()
    mask[20, 20:24] = 0
    for step in range(6):
        mask[40 + step, 40 + step] = 0  # corners do not join holes
    assert np.array_equal(clean(mask), expected)


def test_parts_that_are_mostly_unseen_are_apart_from_the_largest() -> None:
    mask, seen = np.zeros((20, 40), np.bool_), np.zeros((20, 40), np.bool_)
    mask[2:18, 2:18] = True  # the largest: never apart, though little of it is seen
    mask[4:8, 22:26] = mask[12:16, 22:26] = mask[4:8, 30:34] = True  # three parts of 16 pixels
    seen[2:4, 2:4] = seen[4:8, 22:24] = True  # half of the first
    seen[12:16, 22] = True  # a quarter of the second, nothing of the third
    apart = parts_apart(mask, seen)
    assert apart.sum() == 32
    assert apart[12:16, 22:26].all()
    assert apart[4:8, 30:34].all()


def test_nothing_is_apart_from_what_saw_nothing() -> None:
    mask = np.eye(9, dtype=np.bool_)
    mask[0, 8] = True
    assert not parts_apart(mask, np.zeros_like(mask)).any()
    assert parts_apart(mask, np.eye(9, k=4, dtype=np.bool_)).sum() == 1, "corners touch"
    assert not parts_apart(np.zeros_like(mask), mask).any()


def test_mask_name_is_colmaps() -> None:
    assert mask_name("IMG_1.jpg") == "IMG_1.jpg.png"


def test_quality_by_hand() -> None:
    truth, found = np.zeros((10, 10), np.uint8), np.zeros((10, 10), np.uint8)
    truth[:, :5] = 255  # 50 pixels
    found[:, 1:7] = 255  # 60 pixels, 40 of them right
    scored = quality(found, truth)
    assert scored.iou == pytest.approx(40 / 70)
    precision, recall = 40 / 60, 40 / 50
    assert scored.f_measure == pytest.approx(1.3 * precision * recall / (0.3 * precision + recall))
    assert scored.mae == pytest.approx(0.3)
    soft = np.full((10, 10), 0.5, np.float32)
    assert quality(found, truth, soft).mae == pytest.approx(0.5)


def test_quality_of_equal_and_of_disjoint_masks() -> None:
    mask, other = disc(64, (20, 20), 10), disc(64, (50, 50), 5)
    assert quality(mask, mask).as_dict() == {
        "iou": 1, "f_measure": 1, "mae": 0, "boundary_f": 1,
    }  # fmt: skip
    apart = quality(mask, other)
    assert (apart.iou, apart.f_measure, apart.boundary_f) == (0, 0, 0)


def test_boundary_f_forgives_within_its_tolerance_only() -> None:
    truth = disc(400, (200, 200), 100)  # tolerance: 0.0075 * 566 = 4 pixels
    assert boundary_f(disc(400, (200, 200), 103), truth) == 1
    assert boundary_f(disc(400, (200, 200), 110), truth) < 0.05
    assert boundary_f(disc(400, (200, 200), 103), truth, 4) == 1
    assert boundary_f(disc(400, (200, 200), 103), truth, 1) < 0.05
    empty = np.zeros_like(truth)
    assert boundary_f(empty, truth) == 0
    assert boundary_f(empty, empty) == 1


def test_boundary_f_by_hand() -> None:
    truth, found = np.zeros((20, 30), np.uint8), np.zeros((20, 30), np.uint8)
    truth[5:15, 5:15] = 255  # an outline of 36 pixels
    found[5:15, 5:25] = 255  # twice as wide: one of 56
    # three sides agree, 28 pixels, and of each outline one pixel more at either end is beside them
    precision, recall = 30 / 56, 30 / 36
    expected = 2 * precision * recall / (precision + recall)
    assert boundary_f(found, truth, 1) == pytest.approx(expected)
    assert boundary_f(truth, found, 1) == pytest.approx(expected)
