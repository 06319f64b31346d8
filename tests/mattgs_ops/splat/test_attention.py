"""Every map and score against the slow, obvious version of its equation."""

import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.method import MethodConfig
from mattgs_ops.splat.attention import (
    EDGE_BAND,
    FLAT,
    HALF_AT,
    NEIGHBOURHOOD,
    attention_map,
    inner,
    interior_attention,
    local_attention,
    loss_weights,
    paper_attention,
    point_scores,
)

KERNEL_X = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]], dtype=np.float64)
KERNEL_Y = KERNEL_X.T


def slow_magnitude(image: np.ndarray) -> np.ndarray:
    """Eqs. 9–13 pixel by pixel, the image mirrored about its outermost pixels."""
    height, width, _ = image.shape
    grey = image.astype(np.float64).sum(axis=2) / 3

    def at(row: int, column: int) -> float:
        row = abs(row) if row < height else 2 * (height - 1) - row
        column = abs(column) if column < width else 2 * (width - 1) - column
        return float(grey[min(max(row, 0), height - 1), min(max(column, 0), width - 1)])

    out = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            near = np.array([[at(y + j, x + i) for i in (-1, 0, 1)] for j in (-1, 0, 1)])
            out[y, x] = np.hypot((KERNEL_X * near).sum(), (KERNEL_Y * near).sum())
    return out


def photo(height: int = 13, width: int = 17, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((height, width, 3)).astype(np.float32)


@pytest.mark.parametrize("size", [(13, 17), (3, 3), (2, 5), (5, 2)])
def test_the_papers_map_is_sobel_then_min_max(size: tuple[int, int]) -> None:
    image = photo(*size)
    slow = slow_magnitude(image)
    expected = (slow - slow.min()) / (slow.max() - slow.min())
    found = paper_attention(image)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=2e-6)
    assert found.min() == 0
    assert found.max() == 1


@pytest.mark.parametrize("size", [(8, 8), (1, 9), (9, 1), (1, 1)])
def test_a_constant_image_asks_for_no_attention(size: tuple[int, int]) -> None:
    assert not paper_attention(np.full((*size, 3), 0.3, np.float32)).any()


def test_a_step_edge_is_found_where_it_is() -> None:
    image = np.zeros((9, 10, 3), np.float32)
    image[:, 5:] = 1
    found = paper_attention(image)
    assert (found[:, 4:6] == 1).all()
    assert not found[:, :4].any()
    assert not found[:, 6:].any()


def a_disc_in_the_frame() -> tuple[np.ndarray, np.ndarray]:
    """Draw a textured disc on white: its outline is the strongest edge."""
    rows, columns = np.mgrid[:40, :40]
    mask = ((rows - 20) ** 2 + (columns - 20) ** 2 < 14**2).astype(np.float32)
    texture = photo(40, 40, seed=3) * 0.2
    return np.where(mask[:, :, None] > 0, texture, 1).astype(np.float32), mask


@pytest.mark.parametrize("removed", [False, True])
def test_the_interior_map_ignores_the_masks_own_outline(removed: bool) -> None:
    image, mask = a_disc_in_the_frame()
    assert paper_attention(image)[20, 6] > 0.5  # the outline, as the paper's map sees it
    found = interior_attention(image, mask, removed=removed)
    rows, columns = np.mgrid[:40, :40]
    slow = slow_magnitude(image)
    kept = np.zeros((40, 40), dtype=bool)
    for y in range(40):
        for x in range(40):
            near = mask[
                max(y - EDGE_BAND, 0) : y + EDGE_BAND + 1, max(x - EDGE_BAND, 0) : x + EDGE_BAND + 1
            ]
            kept[y, x] = near.all() or (not removed and not near.any())
    expected = np.where(kept, (slow - slow[kept].min()) / np.ptp(slow[kept]), 0)
    np.testing.assert_allclose(found, expected, atol=3e-6)
    assert found.max() == 1  # texture, not the outline, is the strongest now
    outside = (rows - 20) ** 2 + (columns - 20) ** 2 > 17**2
    assert not found[outside].any()


def test_the_interior_map_does_not_take_the_frames_border_for_an_edge() -> None:
    image = photo(12, 12)
    assert interior_attention(image, np.ones((12, 12), np.float32), removed=True)[0].any()


def test_an_empty_mask_leaves_no_attention() -> None:
    assert not interior_attention(photo(), np.zeros((13, 17), np.float32), removed=True).any()


def test_the_kind_chooses_between_training_image_and_photo() -> None:
    composite, original = photo(seed=1), photo(seed=2)
    mask = np.ones((13, 17), np.float32)
    paper = attention_map(composite, original, mask, kind="paper", removed=True)
    interior = attention_map(composite, original, mask, kind="interior", removed=True)
    np.testing.assert_array_equal(paper, paper_attention(composite))
    np.testing.assert_array_equal(interior, paper_attention(original))


def test_the_object_map_is_the_interior_map_without_the_surroundings() -> None:
    image, mask = a_disc_in_the_frame()
    image = np.where(mask[:, :, None] > 0, image, photo(40, 40, seed=4))
    for removed in (False, True):
        found = attention_map(image, image, mask, kind="object", removed=removed)
        np.testing.assert_array_equal(found, interior_attention(image, mask, removed=True))
        assert not found[mask == 0].any()
    surroundings = attention_map(image, image, mask, kind="interior", removed=False)[mask == 0]
    assert surroundings.any()


def test_the_local_map_is_each_edge_beside_those_around_it() -> None:
    """Pixel by pixel: magnitudes of the object, weighted by two squares' pyramid about each."""
    image, mask = a_disc_in_the_frame()
    kept = inner(mask)
    slow = np.where(kept, slow_magnitude(image), 0)
    side = round((6 * (NEIGHBOURHOOD * 40) ** 2 + 1) ** 0.5)
    assert side == 5
    reach = side - 1
    pyramid = side - np.abs(np.arange(-reach, reach + 1))
    padded, inside = np.pad(slow, reach), np.pad(kept.astype(float), reach)
    expected = np.zeros((40, 40))
    for y, x in zip(*np.nonzero(kept), strict=True):
        window = np.outer(pyramid, pyramid) * inside[y : y + 2 * reach + 1, x : x + 2 * reach + 1]
        values = padded[y : y + 2 * reach + 1, x : x + 2 * reach + 1]
        around = (window * values).sum() / window.sum() + FLAT * slow[kept].mean()
        expected[y, x] = slow[y, x] / (slow[y, x] + HALF_AT * around)
    found = local_attention(image, mask)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=2e-5)
    for removed in (False, True):
        chosen = attention_map(image, image, mask, kind="local", removed=removed)
        np.testing.assert_array_equal(chosen, found)


def test_a_glint_takes_no_local_attention_from_print_elsewhere() -> None:
    image = np.full((60, 80, 3), 0.5, np.float32)
    image[20:40, 10:20:2] = 0.55  # print of little contrast
    mask = np.ones((60, 80), np.float32)
    before = local_attention(image, mask)[20:40, 10:20].mean()
    image[28:32, 60:64] = 5.0
    after = {
        kind: attention_map(image, image, mask, kind=kind, removed=True)[20:40, 10:20].mean()
        for kind in ("object", "local")
    }
    assert after["object"] < 0.02
    assert after["local"] > 0.7 * before > 0.07


@pytest.mark.parametrize("value", [0.0, 0.4])
def test_flat_objects_and_empty_masks_have_no_local_attention(value: float) -> None:
    flat = np.full((9, 12, 3), value, np.float32)
    assert not local_attention(flat, np.ones((9, 12), np.float32)).any()
    assert not local_attention(photo(), np.zeros((13, 17), np.float32)).any()


def test_weights_within_the_object_come_from_its_flat_parts() -> None:
    image, mask = a_disc_in_the_frame()
    attention = local_attention(image, mask)
    kept = inner(mask)
    without, with_it = (
        loss_weights(
            attention,
            mask,
            MethodConfig(weighting="within", weight=weight, mask_weight=3.0),
            removed=False,
        )
        for weight in (0.0, 15.0)
    )
    assert without is not None
    assert with_it is not None
    raised = 1 + 15.0 * attention.astype(np.float64)
    expected = (1 + 3.0 * mask) * np.where(kept, raised / raised[kept].mean(), 1)
    np.testing.assert_allclose(with_it, expected / expected.mean(), rtol=1e-5)
    # the outline, what is outside, and the object as a whole weigh what they did
    np.testing.assert_allclose(with_it[~kept], without[~kept], rtol=1e-5)
    assert with_it[kept].mean() == pytest.approx(without[kept].mean(), rel=1e-5)


def test_weights_are_none_the_map_itself_or_raised_to_mean_one() -> None:
    attention = paper_attention(photo())
    mask = np.zeros_like(attention)
    mask[3:9, 4:11] = 1
    assert loss_weights(attention, mask, MethodConfig(), removed=True) is None
    paper = loss_weights(attention, mask, MethodConfig(weighting="paper"), removed=True)
    assert paper is attention
    for mask_weight in (0.0, 3.0):
        method = MethodConfig(weighting="residual", weight=2.5, mask_weight=mask_weight)
        residual = loss_weights(attention, mask, method, removed=True)
        assert residual is not None
        expected = 1 + 2.5 * attention.astype(np.float64) + mask_weight * mask
        np.testing.assert_allclose(residual, expected / expected.mean(), rtol=1e-5)
        assert residual.mean() == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize(("share", "pixels"), [(0.0, 0), (0.03, 0), (0.05, 1), (0.1, 2)])
def test_where_a_mask_may_err_emptiness_weighs_nothing(share: float, pixels: int) -> None:
    rng = np.random.default_rng(6)
    mask = np.zeros((12, 15), np.float32)
    mask[4:9, 6:15] = rng.uniform(0.5, 1, (5, 9))  # touches the frame
    mask[9, 6:15] = 0.4  # mostly not the object
    attention = rng.random(mask.shape).astype(np.float32)
    method = MethodConfig(weighting="residual", mask_weight=3, edge_tolerance=share)

    expected = 1 + attention.astype(np.float64) + 3 * mask
    for y, x in np.ndindex(*mask.shape):
        near = mask[max(y - pixels, 0) : y + pixels + 1, max(x - pixels, 0) : x + pixels + 1]
        if pixels and mask[y, x] < 0.5 <= near.max():
            expected[y, x] = 0
    found = loss_weights(attention, mask, method, removed=True)
    assert found is not None
    np.testing.assert_allclose(found, expected / expected.mean(), rtol=1e-5)

    photo_weights = loss_weights(attention, mask, method, removed=False)
    assert photo_weights is not None
    assert photo_weights.all()  # a photo's surroundings are real, not the mask's word


def camera(x: float) -> Camera:
    """Look along z from (x, 0, -2): 20 × 10 pixels, focal length 10."""
    lens = Intrinsics(20, 10, 10.0, 10.0, 10.0, 5.0)
    return Camera(lens, np.eye(3), np.array([-x, 0.0, 2.0]))


def slow_score(point: np.ndarray, cameras: list[Camera], maps: list[np.ndarray]) -> float:
    values = []
    for view, attention in zip(cameras, maps, strict=True):
        local = view.rotation @ point + view.translation
        if local[2] <= 0:
            continue
        u, v = 10 * local[0] / local[2] + 10, 10 * local[1] / local[2] + 5
        if not (0 <= u < 20 and 0 <= v < 10):
            continue
        padded = np.pad(attention.astype(np.float64), 1, mode="edge")  # borders hold their value
        column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        fx, fy = u + 0.5 - column, v + 0.5 - row
        block = padded[row : row + 2, column : column + 2]
        values.append(np.array([1 - fy, fy]) @ block @ np.array([1 - fx, fx]))
    return float(np.mean(values)) if values else 0.0


def test_a_point_scores_the_mean_attention_where_views_see_it() -> None:
    rng = np.random.default_rng(5)
    cameras = [camera(-1.0), camera(0.0), camera(1.5)]
    maps = [rng.random((10, 20)).astype(np.float32) for _ in cameras]
    points = rng.uniform([-4, -2, -4], [4, 2, 3], (200, 3))
    scores, seen = point_scores(points, cameras, maps)
    expected = [slow_score(point, cameras, maps) for point in points]
    np.testing.assert_allclose(scores, expected, atol=1e-6)
    assert {0, 1, 2, 3} <= set(seen.tolist())
    assert not scores[seen == 0].any()


def test_a_point_in_a_pixels_centre_scores_that_pixel() -> None:
    attention = np.zeros((10, 20), np.float32)
    attention[7, 12] = 1
    # pixel (12, 7) has its centre at (12.5, 7.5): 2.5 right of and below the axis, at depth 2
    scores, _ = point_scores(np.array([[0.5, 0.5, 0.0]]), [camera(0.0)], [attention])
    assert scores[0] == pytest.approx(1)
