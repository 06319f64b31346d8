"""The outline's training: it learns, and a killed run goes on as if it had never stopped."""

from pathlib import Path

import numpy as np
import pytest
import torch

from mattgs_ops.errors import InputError
from mattgs_ops.segment.outline.network import OutlineNet
from mattgs_ops.segment.outline.train import learning_rate, outline_loss, train
from mattgs_ops.segment.outline.train_config import (
    OutlineTrainConfig,
    PaintedConfig,
    load_outline_config,
)

PAINTED = PaintedConfig(count=3, size=64)


def config(steps: int, **more: object) -> OutlineTrainConfig:
    values = {
        "painted": PAINTED,
        "hold_out": 3,
        "batch": 2,
        "size": 32,
        "validate_every": 2,
        **more,
    }
    return OutlineTrainConfig(steps=steps, **values)


class StoppedError(Exception):
    pass


def test_an_untrained_network_gives_the_map_back() -> None:
    torch.manual_seed(0)
    x = torch.rand(1, 4, 32, 48)
    x[:, 3] = x[:, 3].clamp(0.05, 0.95)
    with torch.no_grad():
        shares = torch.sigmoid(OutlineNet().eval()(x))
    assert torch.allclose(shares, x[:, 3:], atol=1e-5)


def test_the_loss_is_the_weighted_mean_of_cross_entropies() -> None:
    rng = np.random.default_rng(0)
    logits, truth, weight = (rng.random((2, 1, 4, 4)) for _ in range(3))
    shares = 1 / (1 + np.exp(-logits))
    each = -(truth * np.log(shares) + (1 - truth) * np.log(1 - shares))
    expected = (each * weight).sum() / weight.sum()
    found = outline_loss(*(torch.from_numpy(a) for a in (logits, truth, weight)))
    assert found.item() == pytest.approx(expected, rel=1e-9)


def test_a_killed_run_goes_on_as_if_never_stopped(tmp_path: Path) -> None:
    settings = config(4)
    whole = train(settings, tmp_path / "whole")
    assert whole.is_file()
    lines = (tmp_path / "whole" / "curve.csv").read_text().splitlines()
    assert lines[0] == "step,train_loss,val_loss,wrong_before,wrong_after"
    assert len(lines) == 3

    def stop(done: int, _total: int, note: str) -> None:
        if done == 3 and note.startswith("loss"):
            raise StoppedError

    with pytest.raises(StoppedError):
        train(settings, tmp_path / "broken", progress=stop)
    train(settings, tmp_path / "broken")
    expected, found = (
        torch.load(tmp_path / name / "outline.pth", weights_only=True)
        for name in ("whole", "broken")
    )
    for key, value in expected.items():
        assert torch.equal(value, found[key]), key
    with pytest.raises(InputError, match="expected a checkpoint of this configuration"):
        train(config(4, lr=1e-3), tmp_path / "whole")


def test_it_learns(tmp_path: Path) -> None:
    losses: list[float] = []

    def listen(_step: int, scores: dict[str, float]) -> None:
        losses.append(scores["train_loss"])

    train(config(160, lr=5e-3, batch=4, validate_every=40), tmp_path, on_metrics=listen)
    assert losses[-1] < 0.9 * losses[0]


def test_the_rate_rises_and_falls() -> None:
    settings = OutlineTrainConfig(steps=1000, lr=1.0)
    rates = [learning_rate(settings, step) for step in (0, 99, 500, 999)]
    assert rates == pytest.approx([0.01, 0.976, 0.5, 0.01], abs=0.01)


def test_a_recipe_names_its_file_and_field(tmp_path: Path) -> None:
    recipe = tmp_path / "r.toml"
    recipe.write_text('steps = 5\nstart_from = "a.pth"\n[painted]\ncount = 2\n')
    loaded = load_outline_config(recipe)
    assert loaded.start_from == tmp_path / "a.pth"
    assert loaded.painted is not None
    assert loaded.painted.count == 2
    recipe.write_text("size = 33")
    with pytest.raises(InputError, match=r"r\.toml: `size`: .* multiple of 16.*found 33"):
        load_outline_config(recipe)
