"""Hard light changes what an image looks like, a close-up what part of it is seen."""

import numpy as np

from mattgs_ops.segment.network.augment import augment, harsh_light
from mattgs_ops.segment.network.train_config import AugmentConfig

SIDE = 64


def checkered(side: int = SIDE) -> np.ndarray:
    tiles = (np.indices((side, side)) // 8).sum(0) % 2
    return np.repeat((60 + 120 * tiles)[..., None], 3, 2).astype(np.uint8)


def test_hard_light_keeps_edges_where_they_are() -> None:
    image = checkered()
    kept = []
    for seed in range(12):
        lit = harsh_light(np.random.default_rng(seed), image).astype(float).mean(2)
        assert lit.shape == (SIDE, SIDE)
        inside = np.abs(lit[:, 2] - lit[:, 5]).mean()  # of one tile
        across = np.abs(lit[:, 6] - lit[:, 9]).mean()  # of two
        kept.append(across > 2 * inside)
    assert sum(kept) >= 11


def test_hard_light_is_darker_on_one_side_and_ranges_from_dim_to_burnt_out() -> None:
    flat = np.full((SIDE, SIDE, 3), 120, np.uint8)
    lit = [harsh_light(np.random.default_rng(seed), flat).astype(float) for seed in range(40)]
    slopes = [abs(x[:, :8].mean() - x[:, -8:].mean()) for x in lit]
    assert np.median(slopes) > 15
    means = [x.mean() for x in lit]
    assert min(means) < 90
    assert max(means) > 200


def test_no_image_gets_hard_light_unless_asked_for() -> None:
    image, mask = checkered(), np.zeros((SIDE, SIDE), np.uint8)
    plain, asked = AugmentConfig(), AugmentConfig(harsh=1.0)
    same, other = (augment(np.random.default_rng(3), image, mask, 48, c)[0] for c in (plain, asked))
    assert np.abs(same.astype(int) - other).mean() > 3


def disc(radius: float, x: float, y: float) -> np.ndarray:
    rows, columns = np.indices((SIDE, SIDE))
    return np.where(np.hypot(columns - x, rows - y) < radius, 255, 0).astype(np.uint8)


def test_a_close_up_shows_a_part_of_the_object_and_some_ground() -> None:
    mask = disc(14, 20, 40)
    image = np.repeat(mask[..., None], 3, 2)
    config = AugmentConfig(rotation=0, close_ups=1.0, crop=1.0)
    shares, cut = [], []
    for seed in range(40):
        _, seen = augment(np.random.default_rng(seed), image, mask, SIDE, config)
        shares.append((seen > 127).mean())
        border = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
        cut.append((border > 127).any())
    whole = (mask > 127).mean()
    assert max(shares) < 0.95
    assert min(shares) > 0.9 * whole
    assert np.median(shares) > 2 * whole
    assert np.mean(cut) > 0.5


def test_an_object_too_small_for_a_close_up_is_seen_whole() -> None:
    mask = disc(2, 30, 30)
    image = np.repeat(mask[..., None], 3, 2)
    config = AugmentConfig(rotation=0, close_ups=1.0, crop=1.0)
    for seed in range(5):
        _, seen = augment(np.random.default_rng(seed), image, mask, SIDE, config)
        assert abs((seen > 127).sum() - (mask > 127).sum()) < 6
