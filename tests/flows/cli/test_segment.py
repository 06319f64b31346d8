"""`mattgs segment`: trainings start and go on from weights, networks become one file."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from flows.cli.app import app
from mattgs_ops.errors import InputError
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork
from mattgs_ops.segment.network.train_config import SegmentTrainConfig
from mattgs_ops.segment.network.u2net import U2Net
from mattgs_ops.segment.outline.refine import BUNDLED_OUTLINE, OutlineRefiner
from tasks.registry.upkeep.moved import DATABASE
from tests.mattgs_ops.segment.small_network import write_network

RECIPE = """
validate_every = 1
validation_images = 1
patterns = 1
[[stages]]
size = 32
batch = 2
steps = {steps}
lr = {rate}
lr_end = {rate}
"""


def trained(
    folder: Path, registry: Path, steps: int, rate: float, *options: str
) -> dict[str, torch.Tensor]:
    """Train by the command, followed in a copy of ``registry``; return the weights."""
    (folder / "out").mkdir(parents=True)
    shutil.copy(registry, folder / "out" / DATABASE)
    recipe = folder / "recipe.toml"
    recipe.write_text(RECIPE.format(steps=steps, rate=rate))
    command = ["segment", "train", str(folder), "--config", str(recipe), *options]
    result = CliRunner().invoke(app, [*command, "--out", str(folder / "out")])
    assert result.exit_code == 0, result.output
    weights: dict[str, torch.Tensor] = torch.load(folder / "u2netp.pth", weights_only=True)
    return weights


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory, fresh_registry: Path) -> Path:
    """Return the folder of a training of two steps."""
    folder = tmp_path_factory.mktemp("trained") / "first"
    trained(folder, fresh_registry, 2, 1e-3)
    return folder


def test_the_second_training_starts_where_the_first_ended(
    first: Path, fresh_registry: Path, tmp_path: Path
) -> None:
    begun_at = torch.load(first / "u2netp.pth", weights_only=True)
    start = ("--start-from", str(first / "u2netp.pth"))
    second = trained(tmp_path / "second", fresh_registry, 1, 1e-12, *start)
    torch.manual_seed(SegmentTrainConfig().seed)
    from_nothing = U2Net("u2netp").state_dict()
    name = "outconv.weight"
    torch.testing.assert_close(second[name], begun_at[name])
    # what a training without a start begins with, to the first one's two steps
    assert not torch.allclose(from_nothing[name], begun_at[name], atol=1e-4)
    torch.testing.assert_close(from_nothing[name], begun_at[name], atol=0.01, rtol=0)


@pytest.mark.parametrize("name", ["missing.pth", "."])
def test_weights_that_are_no_file_are_refused(tmp_path: Path, name: str) -> None:
    command = ["segment", "train", str(tmp_path / "f"), "--start-from", str(tmp_path / name)]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2
    assert not (tmp_path / "f").exists()


def test_two_networks_in_eight_bits_become_one_file(tmp_path: Path) -> None:
    networks = [write_network(tmp_path / f"{seed}.onnx", 32, seed, gain=1) for seed in (0, 1)]
    recipe, small = tmp_path / "recipe.toml", [tmp_path / "a.onnx", tmp_path / "b.onnx"]
    recipe.write_text(RECIPE.format(steps=1, rate=1e-3))
    for path, network, images in zip(small, networks, ("2", "3"), strict=True):
        command = ["segment", "quantize", str(path), str(network), "--config", str(recipe)]
        result = CliRunner().invoke(app, [*command, "--images", images])
        assert result.exit_code == 0, result.output
        assert f"Network: {path.resolve()} (mean difference of its maps " in result.output
    out = tmp_path / "mean.onnx"
    result = CliRunner().invoke(app, ["segment", "combine", str(out), *map(str, small)])
    assert result.exit_code == 0, result.output
    assert f"Segmenter: {out.resolve()} (within " in result.output
    noise = np.random.default_rng(0).normal(size=(2, 3, 32, 32)).astype(np.float32)
    for path, network in zip(small, networks, strict=True):
        before, after = (SaliencyNetwork(one).raw_maps(noise) for one in (network, path))
        assert np.abs(after - before).max() < 0.1
    assert out.stat().st_size < 0.4 * sum(network.stat().st_size for network in networks)


def test_the_bundled_file_asks_three_networks() -> None:
    network = SaliencyNetwork(BUNDLED_MODEL)
    assert (network.width, network.height) == (256, 256)
    assert network.outputs == ["saliency", "saliency/1", "saliency/2", "saliency/3"]
    assert BUNDLED_MODEL.stat().st_size < 8_000_000


def test_an_outline_in_eight_bits_is_refused_for_a_saliency_network(tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text("size = 32\n[painted]\ncount = 2\nsize = 64\n")
    command = [
        "segment",
        "quantize",
        str(tmp_path / "o.onnx"),
        str(BUNDLED_OUTLINE.with_name("outline.onnx")),
    ]
    command += ["--config", str(recipe), "--images", "4"]
    refused = CliRunner().invoke(app, command)
    assert refused.exit_code != 0
    result = CliRunner().invoke(app, [*command, "--outline"])
    assert result.exit_code == 0, result.output
    assert OutlineRefiner(tmp_path / "o.onnx").refine(
        np.zeros((40, 50, 3), np.uint8),
        np.zeros((40, 50), np.float32),
        np.zeros((40, 50), np.uint8),
    ).shape == (40, 50)


def test_an_outline_that_was_trained_can_be_asked(fresh_registry: Path, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(
        "steps = 2\nbatch = 2\nsize = 32\nhold_out = 2\n[painted]\ncount = 2\nsize = 64\n"
    )
    folder = tmp_path / "f"
    command = ["segment", "outline", str(folder), "--config", str(recipe)]
    (tmp_path / "out").mkdir()
    shutil.copy(fresh_registry, tmp_path / "out" / DATABASE)
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
