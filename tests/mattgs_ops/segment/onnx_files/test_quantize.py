"""A network in eight bits says what it said before, from weights that are rounded."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import numpy_helper

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork
from mattgs_ops.segment.onnx_files import quantize as eight_bits
from mattgs_ops.segment.onnx_files.quantize import outer_convolutions, quantize
from mattgs_ops.segment.outline.refine import BUNDLED_OUTLINE
from tests.mattgs_ops.segment.small_network import write_network

SIDE = 32
GAIN = 10  # of the last layer: maps of untrained networks are flat
LEVELS = 127  # of a weight's magnitude
BUNDLED = [
    ("u2netp-traced.onnx", BUNDLED_MODEL, "n0/"),
    ("u2netp-rooms.onnx", BUNDLED_MODEL, "n1/"),
    ("u2netp-corners.onnx", BUNDLED_MODEL, "n2/"),
    ("outline.onnx", BUNDLED_OUTLINE, ""),
]


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_network(tmp_path_factory.mktemp("network") / "network.onnx", SIDE, 0, GAIN)


def noise(count: int, seed: int = 0) -> NDArray[np.float32]:
    shape = count, 3, SIDE, SIDE
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def rounded(weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Round each output channel to 127 levels of its largest magnitude, one after the other."""
    channels = []
    for channel in weights:
        step = np.abs(channel).max() / LEVELS
        channels.append(np.rint(channel / step) * step)
    return np.stack(channels)


def tensors(path: Path) -> dict[str, NDArray[np.float32]]:
    return {one.name: numpy_helper.to_array(one) for one in onnx.load(path).graph.initializer}


def test_maps_stay_and_the_file_shrinks(network: Path, tmp_path: Path) -> None:
    out = tmp_path / "small.onnx"
    difference = quantize(network, noise(8), out)
    unseen = noise(4, seed=1)
    before, after = (SaliencyNetwork(path).raw_maps(unseen) for path in (network, out))
    assert np.abs(after - before).mean() < 2 * difference + 0.005
    assert before.std() > 10 * np.abs(after - before).mean()  # otherwise any map would pass
    assert out.stat().st_size < 0.4 * network.stat().st_size


@pytest.mark.parametrize(("name", "made", "prefix"), BUNDLED)
def test_the_bundled_weights_are_those_of_the_networks_beside_them(
    name: str, made: Path, prefix: str
) -> None:
    source = made.with_name(name)
    floats, found = tensors(source), tensors(made)
    graph = onnx.load(source).graph
    convolutions = [node for node in graph.node if node.op_type == "Conv"]
    outer = outer_convolutions(graph)
    assert len(outer) == 2
    for node in convolutions:
        weights, stored = floats[node.input[1]], prefix + node.input[1]
        if node.name in outer:
            np.testing.assert_array_equal(found[stored], weights)
            continue
        steps = found[f"{stored}_scale"].reshape(-1, 1, 1, 1)
        levels = found[f"{stored}_quantized"]
        assert levels.dtype == np.int8
        # half a step is what rounding may cost; ties may go either way
        np.testing.assert_allclose(levels * steps, weights, atol=0.501 * steps.max())
        np.testing.assert_allclose(levels * steps, rounded(weights), atol=1.001 * steps.max())
        assert np.mean(np.abs(levels * steps - rounded(weights)) > 0.01 * steps) < 0.001


def test_one_picture_is_too_few(network: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected at least 2, found 1"):
        quantize(network, noise(1), tmp_path / "out.onnx")


def test_a_file_that_is_no_network_is_named(tmp_path: Path) -> None:
    (tmp_path / "text.onnx").write_text("no")
    with pytest.raises(InputError, match=r"text\.onnx: expected a network \(ONNX\)"):
        quantize(tmp_path / "text.onnx", noise(2), tmp_path / "out.onnx")


def test_a_network_that_rounding_breaks_is_an_error(
    network: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(eight_bits, "TOLERANCE", 0.0)
    with pytest.raises(StageError, match=r"out\.onnx: expected maps within 0\.0 of "):
        quantize(network, noise(2), tmp_path / "out.onnx")
