"""`mattgs segment`: trainings start and go on from weights, networks become one file."""

from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from flows.cli.app import app
from mattgs_ops.errors import InputError
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork
from mattgs_ops.segment.outline.refine import OutlineRefiner

RECIPE = """
validate_every = 1
validation_images = 1
[[stages]]
size = 32
batch = 2
steps = {steps}
lr = {rate}
lr_end = {rate}
"""


def trained(folder: Path, steps: int, rate: float, *options: str) -> dict[str, torch.Tensor]:
    folder.mkdir(parents=True)
    recipe = folder / "recipe.toml"
    recipe.write_text(RECIPE.format(steps=steps, rate=rate))
    command = ["segment", "train", str(folder), "--config", str(recipe), *options]
    result = CliRunner().invoke(app, [*command, "--out", str(folder / "out")])
    assert result.exit_code == 0, result.output
    weights: dict[str, torch.Tensor] = torch.load(folder / "u2netp.pth", weights_only=True)
    return weights


def test_the_second_training_starts_where_the_first_ended(tmp_path: Path) -> None:
    first = trained(tmp_path / "first", 2, 1e-3)
    start = ("--start-from", str(tmp_path / "first" / "u2netp.pth"))
    second = trained(tmp_path / "second", 1, 1e-12, *start)
    from_nothing = trained(tmp_path / "nothing", 1, 1e-12)
    name = "outconv.weight"
    torch.testing.assert_close(second[name], first[name])
    assert not torch.allclose(from_nothing[name], first[name], atol=1e-4)


@pytest.mark.parametrize("name", ["missing.pth", "."])
def test_weights_that_are_no_file_are_refused(tmp_path: Path, name: str) -> None:
    command = ["segment", "train", str(tmp_path / "f"), "--start-from", str(tmp_path / name)]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2
    assert not (tmp_path / "f").exists()


def test_the_bundled_file_is_what_its_three_networks_become(tmp_path: Path) -> None:
    out = tmp_path / "mean.onnx"
    names = ("u2netp-traced.onnx", "u2netp-rooms.onnx", "u2netp-corners.onnx")
    parts = [str(BUNDLED_MODEL.with_name(name)) for name in names]
    result = CliRunner().invoke(app, ["segment", "combine", str(out), *parts])
    assert result.exit_code == 0, result.output
    assert f"Segmenter: {out.resolve()} (within " in result.output
    assert SaliencyNetwork(out).width == 256
    assert out.read_bytes() == BUNDLED_MODEL.read_bytes()


def test_an_outline_that_was_trained_can_be_asked(tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(
        "steps = 2\nbatch = 2\nsize = 32\nhold_out = 2\n[painted]\ncount = 2\nsize = 64\n"
    )
    folder = tmp_path / "f"
    command = ["segment", "outline", str(folder), "--config", str(recipe)]
    result = CliRunner().invoke(app, [*command, "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert f"Outline: {(folder / 'outline.onnx').resolve()}" in result.output
    mask = np.zeros((40, 50), np.uint8)
    mask[10:30, 10:30] = 255
    photo = np.repeat(mask[..., None], 3, axis=2)
    soft = mask.astype(np.float32) / np.float32(255)
    refined = OutlineRefiner(folder / "outline.onnx").refine(photo, soft, mask)
    assert np.array_equal(refined, mask), "two steps from giving the map back"


def test_a_recipe_for_the_outline_that_is_none_is_refused(tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text("stepz = 2\n")
    command = ["segment", "outline", str(tmp_path / "f"), "--config", str(recipe)]
    result = CliRunner().invoke(app, command)
    assert isinstance(result.exception, InputError)
    assert "unknown key `stepz`" in str(result.exception)
    assert not (tmp_path / "f").exists()
