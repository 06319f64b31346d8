"""Whether renders show the training views: which photo each is nearest to.

Whole checks of another program's splats are in ``tests/tasks/test_other_program.py``.
"""

import numpy as np

from mattgs_ops.score.frame import are_likest

PHOTOS = np.random.default_rng(0).random((9, 48))


def noisy(pictures: np.ndarray, seed: int, deviation: float = 0.02) -> np.ndarray:
    return pictures + np.random.default_rng(seed).normal(0, deviation, pictures.shape)


def test_good_renders_are_likest_to_their_own_photos_and_turned_ones_are_not() -> None:
    assert are_likest(noisy(PHOTOS, 1), PHOTOS).all()
    assert not are_likest(noisy(np.roll(PHOTOS, 3, axis=0), 1), PHOTOS).any()


def test_bursts_and_photos_that_are_there_twice_are_no_rivals() -> None:
    for repeats in (PHOTOS.repeat(2, axis=0), noisy(PHOTOS.repeat(3, axis=0), 2)):
        assert are_likest(noisy(repeats, 3), repeats).all()
        turned = np.roll(repeats, len(repeats) // 3, axis=0)
        assert not are_likest(noisy(turned, 3), repeats).any()
