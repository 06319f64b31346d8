"""The outline's training: it learns, and a killed run goes on as if it had never stopped."""

from pathlib import Path

import cv2
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
    before = (tmp_path / "broken" / "curve.csv").read_text().splitlines()
    with (tmp_path / "broken" / "curve.csv").open("a") as file:
        file.write("4,0.5,0.5,0.5,0.5\n")  # as a kill before the checkpoint of step 4 leaves it
    train(settings, tmp_path / "broken")
    assert before == lines[:2]
    assert (tmp_path / "broken" / "curve.csv").read_text().splitlines() == lines
    expected, found = (
        torch.load(tmp_path / name / "outline.pth", weights_only=True)
        for name in ("whole", "broken")
    )
    for key, value in expected.items():
        assert torch.equal(value, found[key]), key
    with pytest.raises(InputError, match="expected a checkpoint of this configuration"):
        train(config(4, lr=1e-3), tmp_path / "whole")


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (None, r"start\.pth: expected a file of PyTorch weights"),
        (torch.zeros(2), r"start\.pth: expected a table of tensors, found Tensor"),
        ({"a": torch.zeros(1)}, r"start\.pth: expected the layers of the outline's network"),
    ],
)
def test_weights_to_go_on_from_are_refused_before_images_are_drawn(
    tmp_path: Path, state: object, message: str
) -> None:
    file = tmp_path / "start.pth"
    file.write_text("step,train_loss\n")
    if state is not None:
        torch.save(state, file)
    with pytest.raises(InputError, match=message) as refused:
        train(config(1, start_from=file), tmp_path / "run")
    assert len(str(refused.value).splitlines()) == 1
    assert not list((tmp_path / "run").iterdir())


def test_weights_are_gone_on_from(tmp_path: Path) -> None:
    train(config(2), tmp_path / "first")
    file = tmp_path / "first" / "outline.pth"
    train(config(1, start_from=file, lr=1e-12, average=0.0), tmp_path / "second")
    expected, found = (
        torch.load(path, weights_only=True) for path in (file, tmp_path / "second" / "outline.pth")
    )
    torch.testing.assert_close(found["fine.0.weight"], expected["fine.0.weight"])


def test_a_source_without_an_image_to_train_on_is_named(tmp_path: Path) -> None:
    train(config(1), tmp_path)
    (tmp_path / "checkpoint.pt").unlink()
    for k in (1, 2):
        (tmp_path / "painted" / "masks" / f"000{k}.png").write_bytes(
            cv2.imencode(".png", np.zeros((64, 64), np.uint8))[1].tobytes()
        )
    with pytest.raises(InputError, match=r"painted/images: expected two images .* found 1$"):
        train(config(1), tmp_path)


def test_it_learns(tmp_path: Path) -> None:
    losses: list[float] = []

    def listen(_step: int, scores: dict[str, float]) -> None:
        losses.append(scores["train_loss"])

    train(config(80, lr=5e-3, batch=4, validate_every=20), tmp_path, on_metrics=listen)
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
    recipe.write_text("[painted]\ncount = 1")
    with pytest.raises(InputError, match=r"r\.toml: `painted\.count`: .* equal to 2, found 1"):
        load_outline_config(recipe)
    recipe.write_text("size = 33")
    with pytest.raises(InputError, match=r"r\.toml: `size`: .* multiple of 16.*found 33"):
        load_outline_config(recipe)
