"""What ONNX Runtime made of a network is kept: the same bits, in a sixth of the time."""

from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest

from mattgs_ops.segment.onnx_files.optimized_model import open_optimized
from tests.mattgs_ops.segment.small_network import write_network

SIZE = 32


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_network(tmp_path_factory.mktemp("network") / "small.onnx", SIZE, 0, 10)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "mattgs"


def options() -> Any:
    chosen = onnxruntime.SessionOptions()
    chosen.log_severity_level = 3
    return chosen


def answer(session: Any) -> bytes:
    """Return the bytes of a network's map of noise."""
    noise = np.random.default_rng(0).random((1, 3, SIZE, SIZE), np.float32)
    (found,) = session.run(None, {session.get_inputs()[0].name: noise})
    return bytes(found.tobytes())


@pytest.fixture(scope="module")
def plain(network: Path) -> bytes:
    return answer(onnxruntime.InferenceSession(str(network), options(), ["CPUExecutionProvider"]))


def test_the_second_opening_reads_what_the_first_kept(
    network: Path, cache: Path, plain: bytes
) -> None:
    assert answer(open_optimized(network, options, 1)) == plain
    (kept,) = cache.iterdir()
    asked = options()
    assert answer(open_optimized(network, lambda: asked, 1)) == plain
    assert asked.graph_optimization_level.name == "ORT_DISABLE_ALL", "the kept one was opened"
    assert list(cache.iterdir()) == [kept]


@pytest.mark.parametrize("damage", ["half", "empty", "changed"])
def test_a_damaged_file_is_made_anew(network: Path, cache: Path, plain: bytes, damage: str) -> None:
    open_optimized(network, options, 1)
    (kept,) = cache.iterdir()
    whole = kept.read_bytes()
    half = len(whole) // 2
    changed = whole[:half] + bytes([whole[half] ^ 1]) + whole[half + 1 :]
    kept.write_bytes({"half": whole[:half], "empty": b"", "changed": changed}[damage])
    assert answer(open_optimized(network, options, 1)) == plain
    (anew,) = cache.iterdir()
    assert anew.stat().st_size == len(whole)
    assert answer(open_optimized(network, options, 1)) == plain
    assert list(cache.iterdir()) == [anew], "this time it was whole"


def test_other_options_and_other_networks_are_kept_apart(network: Path, cache: Path) -> None:
    other = write_network(network.with_name("other.onnx"), SIZE, 1, 10)
    for path, like in ((network, 1), (network, 2), (other, 1)):
        open_optimized(path, options, like)
    assert len(list(cache.iterdir())) == 3


def test_without_a_place_to_keep_it_a_network_opens_all_the_same(
    network: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plain: bytes
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert answer(open_optimized(network, options, 1)) == plain


def test_what_cannot_be_read_is_refused(cache: Path, tmp_path: Path) -> None:
    (tmp_path / "no.onnx").write_text("no network")
    with pytest.raises(Exception, match=r"no\.onnx"):
        open_optimized(tmp_path / "no.onnx", options, 1)
    assert not list(cache.iterdir())
