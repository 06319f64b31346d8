"""Whether splats lie where cameras look: by what training views show, and by where splats are.

Whole checks of another program's splats are in ``tests/tasks/test_other_program.py``.
"""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from mattgs_ops.errors import StageError
from mattgs_ops.score import frame
from mattgs_ops.score.frame import FARTHEST, SEEN_OPACITY, WIDEST, are_likest, check_frame
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.densify import logit

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


HALVES = np.repeat([0.0, 1.0], 150)  # the pixels of a photo of noise, before they are shuffled
MANY = np.random.default_rng(0).permuted(np.tile(HALVES, (40, 1)), axis=1)
FLAT = 0.25  # their mean square about their own mean colours


def checked(
    shown: np.ndarray, away: float, wider: float, monkeypatch: pytest.MonkeyPatch
) -> str | None:
    """Return what the check says of renders of ``MANY``, and of splats that lie so; None: good."""
    monkeypatch.setattr(frame, "_pictures", lambda _: ([shown], [MANY]))
    monkeypatch.setattr(frame, "_displacement", lambda *_: (away, wider))
    scene: Any = None
    try:
        check_frame(Path(), scene, Path(), "original")
    except StageError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    ("error", "away", "wider", "good"),
    [
        (0.9 * FLAT, 9.0, 9.0, True),  # shown better than by one colour, wherever they lie
        (1.1 * FLAT, 0.0, 1.0, True),
        (1.1 * FLAT, FARTHEST - 0.01, 1.0, True),
        (1.1 * FLAT, FARTHEST + 0.01, 1.0, False),
        (1.1 * FLAT, 0.0, WIDEST - 0.05, True),
        (1.1 * FLAT, 0.0, WIDEST + 0.05, False),
        (1.1 * FLAT, 0.0, 1 / (WIDEST - 0.05), True),
        (1.1 * FLAT, 0.0, 1 / (WIDEST + 0.05), False),
    ],
)
def test_splats_are_elsewhere_where_what_they_show_and_where_they_lie_both_say_so(
    error: float, away: float, wider: float, good: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = checked(MANY + np.sqrt(error), away, wider, monkeypatch)
    assert told is None if good else told is not None and "than one flat colour" in told


@pytest.mark.parametrize(("mixed_up", "words"), [(18, None), (22, "18 of 40 are liker to their")])
def test_most_views_must_be_liker_to_their_own_photo_than_to_another(
    mixed_up: int, words: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = np.concatenate([np.roll(MANY[:mixed_up], 1, axis=0), MANY[mixed_up:]])
    told = checked(shown, 0.0, 1.0, monkeypatch)
    assert told is None if words is None else told is not None and words in told


@pytest.mark.parametrize("background", ["original", "nobg"])
def test_places_are_of_visible_splats_and_without_background_of_the_objects_points(
    background: Any, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    thing, around = rng.normal(0, 1, (400, 3)), rng.normal(5, 3, (400, 3))
    points = SimpleNamespace(
        xyz=np.concatenate([thing, around]), object_share=np.repeat([0.9, 0.1], 400)
    )
    given = thing if background == "nobg" else points.xyz
    moved = 2 * given + [0.5, 0, 0]
    splats = Splats.zeros(2 * len(given))
    splats.quaternions[:, 0] = 1
    splats.means[:] = torch.from_numpy(np.concatenate([moved, moved + 50]))
    splats.opacity_logits[: len(given)] = logit(SEEN_OPACITY + 0.01)
    splats.opacity_logits[len(given) :] = logit(SEEN_OPACITY - 0.01)
    write_ply(splats, tmp_path / "splats.ply")
    low, high = np.percentile(given, (25, 75), axis=0)
    away = np.linalg.norm(np.median(moved, axis=0) - np.median(given, axis=0))
    scene: Any = SimpleNamespace(points=lambda: points)
    found = frame._displacement(scene, tmp_path / "splats.ply", background)
    assert found == pytest.approx((away / np.linalg.norm(high - low), 2.0), rel=1e-5)
