"""What training sees of a photo: area filter, compositing, 8 bits, clear refusals."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.errors import InputError
from mattgs_ops.splat.photos import load_view, recolour, size_at, store_views


@pytest.fixture
def view(tiny_scene: Scene) -> View:
    """Make noise of a photo and its mask, to tell filters apart."""
    rng = np.random.default_rng(0)
    chosen = tiny_scene.views[1]
    cv2.imwrite(str(chosen.photo), rng.integers(0, 256, (36, 48, 3), dtype=np.uint8))
    cv2.imwrite(str(chosen.mask), rng.choice(np.array([0, 255], np.uint8), (36, 48)))
    return chosen


def read(view: View) -> tuple[np.ndarray, np.ndarray]:
    photo = np.asarray(cv2.imread(str(view.photo)), dtype=np.float64)[:, :, ::-1] / 255
    mask = np.asarray(cv2.imread(str(view.mask), cv2.IMREAD_GRAYSCALE), dtype=np.float64) / 255
    return photo, mask


def block_mean(values: np.ndarray, factor: int) -> np.ndarray:
    height, width = values.shape[:2]
    blocks = values.reshape(height // factor, factor, width // factor, factor, -1)
    return blocks.mean(axis=(1, 3)).squeeze()


@pytest.mark.parametrize(
    ("size", "resolution", "expected"),
    [
        ((640, 480), 320, (320, 240)),
        ((480, 640), 320, (240, 320)),
        ((100, 80), 320, (100, 80)),
        ((333, 100), 100, (100, 30)),
        ((1000, 2), 10, (10, 1)),
    ],
)
def test_the_longest_side_shrinks_and_never_grows(
    size: tuple[int, int], resolution: int, expected: tuple[int, int]
) -> None:
    assert size_at(*size, resolution) == expected


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_a_photo_shrinks_by_the_mean_of_what_each_pixel_covers(view: View, factor: int) -> None:
    photo, mask = read(view)
    found = load_view(view, "original", 48 // factor)
    assert found.image.dtype == np.float32
    np.testing.assert_allclose(found.image, block_mean(photo, factor), atol=0.51 / 255)
    np.testing.assert_allclose(found.mask, block_mean(mask, factor), atol=0.51 / 255)


def test_a_fractional_factor_weights_by_area(view: View) -> None:
    photo, _ = read(view)
    found = load_view(view, "original", 32)  # 1.5 old pixels per new one, both ways
    along = np.zeros((32, 48))
    for new in range(32):
        for old in range(48):
            along[new, old] = max(0.0, min(1.5 * (new + 1), old + 1) - max(1.5 * new, old)) / 1.5
    expected = np.einsum("yh,xw,hwc->yxc", along[:24, :36], along, photo)
    np.testing.assert_allclose(found.image, expected, atol=0.51 / 255)


def test_nobg_composites_on_white_before_it_shrinks(view: View) -> None:
    photo, mask = read(view)
    found = load_view(view, "nobg", 24)
    expected = block_mean(photo * mask[:, :, None] + 1 - mask[:, :, None], 2)
    np.testing.assert_allclose(found.image, expected, atol=0.51 / 255)


def test_images_hold_multiples_of_one_255th(view: View) -> None:
    image = load_view(view, "nobg", 32).image
    np.testing.assert_array_equal(np.rint(image * 255).astype(np.float32) / np.float32(255), image)


def test_the_camera_follows_the_size(view: View) -> None:
    camera = load_view(view, "original", 24).camera
    assert (camera.intrinsics.width, camera.intrinsics.height) == (24, 18)
    assert view.camera is not None
    assert camera.intrinsics.fx == view.camera.intrinsics.fx / 2


def test_another_colour_behind_the_object(view: View) -> None:
    photo, mask = read(view)
    colour = (0.2, 0.7, 0.4)
    stored = load_view(view, "nobg", 24)
    expected = block_mean(photo * mask[:, :, None] + np.array(colour) * (1 - mask[:, :, None]), 2)
    np.testing.assert_allclose(
        recolour(stored.image, stored.mask, colour), expected, atol=1.02 / 255
    )


def test_views_are_kept_at_eight_bits(view: View) -> None:
    stored = store_views([view], "nobg", 24)[0]
    assert stored.image.dtype == stored.mask.dtype == stored.photo.dtype == np.uint8
    original = load_view(view, "original", 24).image
    np.testing.assert_array_equal(stored.photo / np.float32(255), original)


def test_a_missing_photo_is_named(view: View) -> None:
    view.photo.unlink()
    with pytest.raises(InputError, match=str(view.photo)):
        load_view(view, "original", 24)


def test_a_broken_photo_is_named(view: View) -> None:
    for content in (b"", b"not a picture"):
        view.photo.write_bytes(content)
        with pytest.raises(InputError, match=f"{view.photo}: expected a readable photo"):
            load_view(view, "original", 24)


def test_a_photo_of_another_size_is_refused(view: View) -> None:
    with pytest.raises(InputError, match=r"expected 50 x 36 pixels, found 48 x 36"):
        load_view(replace(view, width=50), "original", 24)


def test_nobg_needs_a_mask(view: View) -> None:
    bare = replace(view, mask=None)
    with pytest.raises(InputError, match=r"01\.jpg.*mask"):
        load_view(bare, "nobg", 24)
    assert (load_view(bare, "original", 24).mask == 1).all()


def test_a_view_without_a_camera_is_refused(view: View) -> None:
    with pytest.raises(InputError, match="camera"):
        load_view(replace(view, camera=None), "original", 24)
