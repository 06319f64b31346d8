"""One file of several networks says the mean of what each says."""

from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from numpy.typing import NDArray

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.segment.network import ensemble
from mattgs_ops.segment.network.saliency import SaliencyNetwork
from tests.mattgs_ops.segment.small_network import write_network

GAIN = 10  # of the last layer: maps of untrained networks are flat


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("networks")
    return [write_network(folder / f"{side}.onnx", side, side, GAIN) for side in (32, 48)]


def expected_map(path: Path, image: NDArray[np.float32], side: int) -> NDArray[np.float64]:
    """Say what one network adds to the mean, step by step; ``image`` is [side, side, 3]."""
    asked = SaliencyNetwork(path)
    small = cv2.resize(image, (asked.width, asked.width), interpolation=cv2.INTER_LINEAR)
    (raw,) = asked.raw_maps(small.transpose(2, 0, 1)[None].copy())
    values = (raw.astype(np.float64) - raw.min()) / (raw.max() - raw.min())
    return np.clip(cv2.resize(values, (side, side), interpolation=cv2.INTER_CUBIC), 0, 1)


def test_the_map_is_the_mean_of_both_at_the_larger_side(pair: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "mean.onnx"
    assert ensemble.combine(pair, out) < ensemble.TOLERANCE
    both = SaliencyNetwork(out)
    assert (both.width, both.height) == (48, 48)
    images = np.random.default_rng(3).normal(size=(3, 48, 48, 3)).astype(np.float32)
    found = both.raw_maps(images.transpose(0, 3, 1, 2).copy())
    for image, one in zip(images, found, strict=True):
        wanted = np.mean([expected_map(path, image, 48) for path in pair], axis=0)
        np.testing.assert_allclose(one, wanted, atol=0.01)
        assert wanted.std() > 0.02  # otherwise any map would pass


def test_what_each_network_says_is_there_too(pair: list[Path], tmp_path: Path) -> None:
    ensemble.combine(pair, tmp_path / "mean.onnx")
    photo = np.random.default_rng(5).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    both = SaliencyNetwork(tmp_path / "mean.onnx")
    (said,) = both.all_maps([photo], ["a"])
    mean, first, second = said
    np.testing.assert_array_equal(both.soft_maps([photo], ["a"])[0], mean)
    assert np.abs(first - second).max() > 0.2
    assert all(one.shape == (60, 80) for one in said)
    # the second has the file's own side, and sees the photo as it does by itself
    (alone,) = SaliencyNetwork(pair[1]).soft_maps([photo], ["a"])
    np.testing.assert_allclose(second, alone, atol=0.01)


def test_two_networks_need_the_room_of_one(pair: list[Path], tmp_path: Path) -> None:
    ensemble.combine(pair, tmp_path / "mean.onnx")
    sizes = [path.stat().st_size for path in pair]
    assert (tmp_path / "mean.onnx").stat().st_size < 1.1 * max(sizes)


def test_a_network_that_finds_nothing_adds_nothing(pair: list[Path], tmp_path: Path) -> None:
    flat = write_network(tmp_path / "flat.onnx", 48, 2, gain=0)
    ensemble.combine([pair[1], flat], tmp_path / "mean.onnx")
    image = np.random.default_rng(4).normal(size=(48, 48, 3)).astype(np.float32)
    (found,) = SaliencyNetwork(tmp_path / "mean.onnx").raw_maps(image.transpose(2, 0, 1)[None])
    np.testing.assert_allclose(found, expected_map(pair[1], image, 48) / 2, atol=0.01)


def test_what_is_refused(pair: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "mean.onnx"
    with pytest.raises(InputError, match="expected at least two ONNX files, found 1"):
        ensemble.combine(pair[:1], out)
    other = onnx.load(pair[0])
    other.opset_import[0].version = 16
    onnx.save(other, tmp_path / "old.onnx")
    with pytest.raises(InputError, match=r"old\.onnx: expected ONNX's opset 17, found 16"):
        ensemble.combine([pair[0], tmp_path / "old.onnx"], out)
    free = onnx.load(pair[0])
    free.graph.input[0].type.tensor_type.shape.dim[2].dim_param = "height"
    onnx.save(free, tmp_path / "free.onnx")
    with pytest.raises(InputError, match=r"free\.onnx: expected an input of a fixed square side"):
        ensemble.combine([pair[0], tmp_path / "free.onnx"], out)
    assert not out.exists()


def test_a_file_that_is_not_the_mean_is_an_error(
    pair: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ensemble, "TOLERANCE", -1.0)
    with pytest.raises(StageError, match="expected the mean of the networks' maps within"):
        ensemble.combine(pair, tmp_path / "mean.onnx")
