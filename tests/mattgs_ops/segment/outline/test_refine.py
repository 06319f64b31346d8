"""Asking the outline's network: masks come nearer to the truth, and only near their outline."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.capture.masks import quality
from mattgs_ops.errors import InputError
from mattgs_ops.segment.outline.refine import BUNDLED_OUTLINE, REACH, OutlineRefiner

HEIGHT, WIDTH = 200, 260


def scene() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Draw a reddish body with two legs on a grainy grey ground, and its exact mask."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.rectangle(mask, (70, 50), (190, 110), 255, -1)
    for x in (85, 165):
        cv2.rectangle(mask, (x, 110), (x + 12, 160), 255, -1)
    rng = np.random.default_rng(0)
    photo = rng.normal(120, 6, (HEIGHT, WIDTH, 3))
    photo[mask > 0] = rng.normal((170, 60, 50), 6, (int((mask > 0).sum()), 3))
    return np.clip(cv2.GaussianBlur(photo, (0, 0), 0.7), 0, 255).astype(np.uint8), mask


def coarse_of(mask: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return a map as splats render it: small, washed out, two pixels too wide."""
    wide = cv2.dilate(mask, np.ones((5, 5), np.uint8)).astype(np.float32) / 255
    small = cv2.resize(wide, (WIDTH // 3, HEIGHT // 3), interpolation=cv2.INTER_AREA)
    return np.clip(cv2.resize(small, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC), 0, 1)


def cut(map_: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.where(map_ >= 0.5, 255, 0).astype(np.uint8)


@pytest.fixture(scope="module")
def refiner() -> OutlineRefiner:
    return OutlineRefiner()


def test_the_outline_moves_to_the_objects(refiner: OutlineRefiner) -> None:
    photo, truth = scene()
    soft = coarse_of(truth)
    before = quality(cut(soft), truth).iou
    after = quality(refiner.refine(photo, soft, cut(soft)), truth).iou
    assert before < 0.9
    assert after > 0.97


def test_a_photo_larger_than_the_network_sees_is_shrunk_for_it(refiner: OutlineRefiner) -> None:
    size = WIDTH * 6, HEIGHT * 6
    photo, truth = (cv2.resize(a, size, interpolation=cv2.INTER_LINEAR) for a in scene())
    soft = cv2.resize(coarse_of(scene()[1]), size, interpolation=cv2.INTER_LINEAR)
    refined = refiner.refine(photo, soft, cut(soft))
    assert refined.shape == truth.shape
    assert quality(refined, truth).iou > quality(cut(soft), truth).iou + 0.05


def test_a_look_from_afar_mends_what_is_out_of_reach(refiner: OutlineRefiner) -> None:
    size = WIDTH * 6, HEIGHT * 6
    photo, truth = (cv2.resize(a, size, interpolation=cv2.INTER_LINEAR) for a in scene())
    bitten = truth.copy()
    cv2.circle(bitten, (700, 300), 80, 0, -1)  # 16 pixels of 1,024 are 24 here
    soft = bitten.astype(np.float32) / 255
    mended = refiner.mend(photo, soft)
    near, afar = (refiner.refine(photo, map_, cut(map_)) for map_ in (soft, mended))
    assert quality(near, truth).iou < 0.98
    assert quality(afar, truth).iou > 0.995
    agrees = cut(mended) == cut(soft)
    assert np.array_equal(mended[agrees], soft[agrees])


def test_what_is_far_from_the_outline_stays(refiner: OutlineRefiner) -> None:
    photo, truth = scene()
    soft = coarse_of(truth)
    mask = cut(soft)
    noise = np.random.default_rng(1).integers(0, 256, photo.shape).astype(np.uint8)
    refined = refiner.refine(noise, soft, mask)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * REACH + 1, 2 * REACH + 1))
    far = cv2.dilate(mask, disc) == cv2.erode(mask, disc)
    assert far.any()
    assert np.array_equal(refined[far], mask[far])


def test_where_the_network_is_not_sure_the_mask_stays(
    refiner: OutlineRefiner, monkeypatch: pytest.MonkeyPatch
) -> None:
    photo, truth = scene()
    soft = coarse_of(truth)
    monkeypatch.setattr("mattgs_ops.segment.outline.refine.SURE", 1.1)
    assert np.array_equal(refiner.refine(photo, soft, cut(soft)), cut(soft))


@pytest.mark.parametrize("value", [0, 255])
def test_a_mask_without_an_outline_comes_back(refiner: OutlineRefiner, value: int) -> None:
    photo, _ = scene()
    mask = np.full((HEIGHT, WIDTH), value, np.uint8)
    assert np.array_equal(
        refiner.refine(photo, mask.astype(np.float32) / np.float32(255), mask), mask
    )


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"none\.onnx: expected an outline model \(ONNX\), found no"
    ):
        OutlineRefiner(tmp_path / "none.onnx")
    (tmp_path / "text.onnx").write_text("no")
    with pytest.raises(InputError, match=r"text\.onnx: expected an outline model"):
        OutlineRefiner(tmp_path / "text.onnx")
    assert BUNDLED_OUTLINE.with_name("outline.onnx").stat().st_size < 1_100_000
    assert BUNDLED_OUTLINE.stat().st_size < 1_100_000
