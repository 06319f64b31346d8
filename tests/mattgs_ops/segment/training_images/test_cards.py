"""Cards lie around the object and behind it, are of high contrast, and leave its mask alone."""

import numpy as np
import pytest

from mattgs_ops.segment.network.augment import augment
from mattgs_ops.segment.network.train_config import AugmentConfig
from mattgs_ops.segment.training_images.cards import KINDS, lay_cards

SIDE = 128


@pytest.fixture(name="scene")
def _scene() -> tuple[np.ndarray, np.ndarray]:
    """Return a grey image and the mask of a disc in its middle."""
    y, x = np.indices((SIDE, SIDE)) - SIDE / 2
    mask = np.where(np.hypot(x, y) < 30, 255, 0).astype(np.uint8)
    return np.full((SIDE, SIDE, 3), 120, np.uint8), mask


@pytest.mark.parametrize("kind", range(len(KINDS)))
def test_a_card_is_a_small_picture_of_high_contrast(kind: int) -> None:
    for seed in range(5):
        card = KINDS[kind](np.random.default_rng(seed))
        assert card.dtype == np.uint8
        assert card.shape[2] == 3
        assert np.ptp(card) > 100


def test_cards_are_seen_around_the_object_and_never_on_it(
    scene: tuple[np.ndarray, np.ndarray],
) -> None:
    image, mask = scene
    changed = np.zeros((SIDE, SIDE))
    for seed in range(30):
        laid = lay_cards(np.random.default_rng(seed), image, mask)
        assert np.array_equal(laid[mask == 255], image[mask == 255])
        differs = np.abs(laid.astype(int) - image).max(axis=2) > 10
        assert 0.0001 < differs.mean() < 0.6
        changed += differs
    left, right = changed[:, : SIDE // 2].sum(), changed[:, SIDE // 2 :].sum()
    assert 0.5 < left / right < 2  # on all sides


def test_cards_are_as_dark_as_what_they_lie_on(scene: tuple[np.ndarray, np.ndarray]) -> None:
    image, mask = scene
    dark = (image // 12).astype(np.uint8)
    whitest = [int(lay_cards(np.random.default_rng(seed), dark, mask).max()) for seed in range(20)]
    assert max(whitest) < 80


@pytest.mark.parametrize("value", [0, 255])
def test_without_an_object_or_without_ground_nothing_is_laid(value: int) -> None:
    image = np.full((SIDE, SIDE, 3), 90, np.uint8)
    mask = np.full((SIDE, SIDE), value, np.uint8)
    assert np.array_equal(lay_cards(np.random.default_rng(0), image, mask), image)


def test_no_image_gets_cards_unless_asked_for(scene: tuple[np.ndarray, np.ndarray]) -> None:
    def results(config: AugmentConfig) -> tuple[np.ndarray, np.ndarray]:
        return augment(np.random.default_rng(4), *scene, SIDE, config)

    still = {"crop": 1.0, "rotation": 0.0, "flip_horizontal": 0.0, "flip_vertical": 0.0}
    plain, plain_mask = results(AugmentConfig(**still))
    asked, asked_mask = results(AugmentConfig(**still, cards=1.0))
    assert np.array_equal(plain_mask, asked_mask)
    assert plain.std() < asked.std()
