"""Training: it learns, it is deterministic, a resumed run equals an uninterrupted one."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from mattgs_ops.errors import InputError
from mattgs_ops.segment.network.ahead import batches_ahead
from mattgs_ops.segment.network.augment import augment
from mattgs_ops.segment.network.batches import Batches
from mattgs_ops.segment.network.preprocess import network_input, network_inputs
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL
from mattgs_ops.segment.network.train import identity_of, learning_rate, train
from mattgs_ops.segment.network.train_config import (
    AugmentConfig,
    FolderConfig,
    SegmentTrainConfig,
    StageConfig,
    load_train_config,
)

SIZE = 32


def photos(folder: Path, count: int = 3) -> FolderConfig:
    """Bright discs on dark noise: the easiest saliency there is."""
    rng = np.random.default_rng(0)
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    for i in range(count):
        mask = np.zeros((48, 64), np.uint8)
        cv2.circle(mask, (int(rng.integers(24, 40)), 24), 14, 255, -1)
        image = rng.integers(0, 60, (48, 64, 3)).astype(np.uint8)
        image[mask > 0] = (40, 90, 250)
        cv2.imwrite(str(folder / "images" / f"p{i}.jpg"), image)
        cv2.imwrite(str(folder / "masks" / f"p{i}.jpg.png"), mask)
    return FolderConfig(images=folder / "images", masks=folder / "masks", share=1.0)


def config(folder: FolderConfig, steps: int, **more: object) -> SegmentTrainConfig:
    stage = StageConfig(size=SIZE, batch=2, steps=steps, lr=2e-3, lr_end=2e-3)
    values: dict[str, Any] = {"validation_images": 1, "validate_every": 1000, "patterns": 1}
    values |= {"composites": False} | more
    return SegmentTrainConfig(stages=(stage,), folders=(folder,), **values)


class StoppedError(Exception):
    pass


def test_loss_falls_and_a_killed_run_goes_on_as_if_never_stopped(tmp_path: Path) -> None:
    data = photos(tmp_path / "data")
    settings = config(data, steps=4, checkpoint_every=2, average=0.5, validate_every=1)
    losses: list[float] = []

    def listen(_done: int, _total: int, note: str) -> None:
        losses.append(float(note.removeprefix("loss ")))

    whole = train(settings, tmp_path / "whole", progress=listen)
    assert whole.steps == 4
    assert losses[-1] < 0.9 * losses[0]
    assert set(whole.scores) == {"val_loss", "iou", "f_measure", "mae", "boundary_f"}

    def stop(done: int, _total: int, _note: str) -> None:
        if done == 3:
            raise StoppedError

    with pytest.raises(StoppedError):
        train(settings, tmp_path / "broken", progress=stop)
    resumed = train(settings, tmp_path / "broken")
    assert len({(tmp_path / run / "curve.csv").read_text() for run in ("whole", "broken")}) == 1
    expected = torch.load(whole.weights, weights_only=True)
    found = torch.load(resumed.weights, weights_only=True)
    for key, value in expected.items():
        assert torch.equal(value, found[key]), key


def test_bfloat16_learns_what_float32_learns(tmp_path: Path) -> None:
    data = photos(tmp_path / "data")
    ends = {}
    for precision in ("float32", "bfloat16"):
        losses: list[float] = []

        def listen(_done: int, _total: int, note: str, into: list[float] = losses) -> None:
            into.append(float(note.removeprefix("loss ")))

        settings = config(data, steps=4, precision=precision)
        done = train(settings, tmp_path / precision, progress=listen)
        ends[precision] = losses
        assert all(
            v.dtype == torch.float32
            for v in torch.load(done.weights).values()
            if v.is_floating_point()
        )
        assert losses[-1] < 0.95 * losses[0]
    # the first loss is of the same weights; later ones part, as rounding steers Adam elsewhere
    assert ends["bfloat16"][0] == pytest.approx(ends["float32"][0], rel=0.01)
    assert ends["bfloat16"] != ends["float32"]


def test_a_checkpoint_of_another_configuration_is_refused(tmp_path: Path) -> None:
    data = photos(tmp_path / "data")
    train(config(data, steps=1), tmp_path / "run")
    with pytest.raises(InputError, match=r"checkpoint\.pt: expected a checkpoint of this"):
        train(config(data, steps=1, seed=5), tmp_path / "run")
    (tmp_path / "run" / "checkpoint.pt").write_bytes(b"half written")
    with pytest.raises(InputError, match="expected a checkpoint of a training"):
        train(config(data, steps=1), tmp_path / "run")


def test_where_it_runs_is_not_part_of_a_trainings_identity(tmp_path: Path) -> None:
    data = photos(tmp_path / "data")
    base = config(data, steps=1)
    assert identity_of(base) == identity_of(config(data, steps=1, threads=2, workers=1))
    fresh = config(data, steps=1, reuse=1)
    assert identity_of(fresh) == identity_of(config(data, steps=1, reuse=1, workers=3))
    # lanes of several processes show other composites again
    assert identity_of(base) != identity_of(config(data, steps=1, workers=3))
    assert identity_of(base) != identity_of(config(data, steps=1, loss="bce_dice"))


def test_batches_depend_on_the_step_alone() -> None:
    stages = (
        StageConfig(size=32, batch=3, steps=2),
        StageConfig(size=48, batch=2, steps=2),
    )
    settings = SegmentTrainConfig(stages=stages, reuse=2, pool=4)
    forward, again = Batches(settings), Batches(settings)
    seen = [forward.at(step) for step in range(4)]
    assert [x.shape for x, _ in seen] == [(3, 32, 32, 3)] * 2 + [(2, 48, 48, 3)] * 2
    for step in (3, 1):
        for a, b in zip(seen[step], again.at(step), strict=True):
            assert np.array_equal(a, b)
    images, masks = seen[0]
    assert images.dtype == masks.dtype == np.uint8
    assert (masks.min(), masks.max()) == (0, 255)
    assert not np.array_equal(images[0], images[1])


def test_processes_draw_the_batches_that_a_thread_draws(tmp_path: Path) -> None:
    stages = (StageConfig(size=32, batch=2, steps=5),)
    settings = SegmentTrainConfig(stages=stages, reuse=2, pool=4)
    alone = list(batches_ahead(Batches(settings), tmp_path, 0))
    shared = settings.model_copy(update={"workers": 1})
    resumed = list(batches_ahead(Batches(shared), tmp_path, 2))
    assert (len(alone), len(resumed)) == (5, 3)
    for one, other in zip(alone[2:], resumed, strict=True):
        for a, b in zip(one, other, strict=True):
            assert np.array_equal(a, b)


def test_each_process_shows_its_own_composites_again() -> None:
    stages = (StageConfig(size=32, batch=4, steps=7), StageConfig(size=32, batch=4, steps=6))
    settings = SegmentTrainConfig(stages=stages, reuse=2, pool=12, workers=3)
    batches = Batches(settings)
    drawn: dict[int, set[int]] = {step: set() for step in range(13)}

    def note(index: int, size: int) -> tuple[np.ndarray, np.ndarray]:
        drawn[step].add(index)
        return np.zeros((size, size, 3), np.uint8), np.zeros((size, size), np.uint8)

    batches._composite = note  # type: ignore[method-assign]
    for step in range(13):
        batches.at(step)
        assert {2 * step, 2 * step + 1} <= drawn[step]  # two new ones, numbered by the step
        leg = range(7) if step < 7 else range(7, 13)
        lane = [s for s in leg if s <= step and s % 3 == step % 3]
        allowed = {2 * s + k for s in lane[-2:] for k in range(2)}  # a third of the pool
        assert drawn[step] <= allowed
    assert any(len(shown) > 2 for shown in drawn.values())


def test_a_batch_becomes_what_each_photo_becomes() -> None:
    images = np.random.default_rng(3).integers(0, 200, (3, 16, 16, 3)).astype(np.uint8)
    images[1] = 0  # a black photo is divided by 1
    expected = np.stack([network_input(image, 16, 16) for image in images])
    found = network_inputs(torch.from_numpy(images))
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=1e-6)


def test_processes_that_share_nothing_draw_what_lanes_prescribe(tmp_path: Path) -> None:
    stages = (StageConfig(size=32, batch=2, steps=5),)
    settings = SegmentTrainConfig(stages=stages, reuse=2, pool=4, workers=2)
    batches = Batches(settings)
    for step, drawn in enumerate(batches_ahead(Batches(settings), tmp_path, 0)):
        for a, b in zip(drawn, batches.at(step), strict=True):
            assert np.array_equal(a, b)


def test_folders_and_composites_are_mixed_by_share(tmp_path: Path) -> None:
    folder = photos(tmp_path / "data").model_copy(update={"share": 0.5})
    stage = StageConfig(size=32, batch=12, steps=1)
    mixed = SegmentTrainConfig(stages=(stage,), folders=(folder,), reuse=12, seed=1)
    batches = Batches(mixed)
    batches.at(0)
    picks = [batches._folder(np.random.default_rng(i)) is not None for i in range(400)]
    assert 0.4 < np.mean(picks) < 0.6


def test_augmentation_keeps_image_and_mask_together() -> None:
    mask = np.zeros((60, 80), np.uint8)
    mask[20:45, 30:70] = 255
    image = np.repeat(mask[..., None], 3, 2)
    settings = AugmentConfig(crop=0.6, rotation=40, flip_vertical=0.5)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        changed, moved = augment(rng, image, mask, 40, settings)
        assert changed.shape == (40, 40, 3)
        grey = changed.mean(2)
        bright, dark = grey[moved > 250], grey[moved < 5]
        assert np.median(bright) > np.median(dark) + 60
        clear = (moved < 5) | (moved > 250)
        guess = grey > (np.median(bright) + np.median(dark)) / 2
        assert (guess == (moved > 127))[clear].mean() > 0.97


def test_rates_follow_the_legs() -> None:
    stages = (
        StageConfig(size=32, batch=1, steps=100, lr=1e-2, lr_end=1e-3),
        StageConfig(size=64, batch=1, steps=100, lr=5e-4, lr_end=1e-5),
    )
    rates = [learning_rate(stages, step) for step in range(200)]
    assert rates[0] == pytest.approx(1e-3)  # the rise starts at a tenth
    assert rates[50] == pytest.approx(5.5e-3)
    assert rates[99] == pytest.approx(1e-3, rel=0.01)
    assert rates[150] == pytest.approx((5e-4 + 1e-5) / 2)
    assert rates[199] == pytest.approx(1e-5, rel=0.02)


RECIPES = (
    "train.toml",
    "train-long.toml",
    "train-desks.toml",
    "train-wide.toml",
    "train-u2net.toml",
    "train-rooms.toml",
)


@pytest.mark.parametrize("recipe", RECIPES)
def test_shipped_recipes_are_valid_and_end_small(recipe: str) -> None:
    config = load_train_config(BUNDLED_MODEL.with_name(recipe))
    rates = [learning_rate(config.stages, step) for step in (0, config.steps - 1)]
    assert rates[1] < 2 * config.stages[-1].lr_end
    assert config.rendered is not None


def test_configuration_from_toml(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text(
        'seed = 3\nstart_from = "w.pth"\n[[stages]]\nsize = 64\nbatch = 2\nsteps = 5\n'
        '[[folders]]\nimages = "a"\nmasks = "b"\n'
    )
    loaded = load_train_config(path)
    assert (loaded.seed, loaded.steps) == (3, 5)
    assert loaded.start_from == tmp_path.resolve() / "w.pth"
    assert loaded.folders[0].images == tmp_path.resolve() / "a"
    path.write_text("colour = 3\n")
    with pytest.raises(InputError, match=r"t\.toml: unknown key `colour`"):
        load_train_config(path)
    path.write_text("composites = false\n")
    with pytest.raises(InputError, match="found neither"):
        load_train_config(path)
    path.write_text("[world]\nplain = 0.7\nwalls = 0.5\n")
    with pytest.raises(InputError, match=r"world.*at most 1 together, found 1\.2"):
        load_train_config(path)
    with pytest.raises(InputError, match="expected a readable TOML file"):
        load_train_config(tmp_path / "none.toml")


def test_bad_training_folders_are_named(tmp_path: Path) -> None:
    good = photos(tmp_path / "data")
    empty = tmp_path / "empty"
    empty.mkdir()
    for images, masks, message in (
        (tmp_path / "nowhere", good.masks, "nowhere: expected a folder of photos"),
        (empty, good.masks, "empty: expected photos"),
        (good.images, empty, r"p0\.jpg"),
    ):
        bad = FolderConfig(images=images, masks=masks)
        with pytest.raises(InputError, match=message):
            Batches(config(bad, steps=1))
    (good.images / "p1.jpg").write_bytes(b"no photo")
    with pytest.raises(InputError, match=r"p1\.jpg: expected a readable photo"):
        Batches(config(good, steps=1)).folders[0].sample(1)


def test_cuda_is_refused_where_there_is_none(tmp_path: Path) -> None:
    if torch.cuda.is_available():
        pytest.skip("there is a CUDA device")
    with pytest.raises(InputError, match="expected a CUDA device"):
        train(config(photos(tmp_path / "data"), steps=1, device="cuda"), tmp_path / "run")
