"""ONNX files are computed exactly on every CPU, in eight bits too."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork
from mattgs_ops.segment.onnx_files.onnx_file import has_vnni, open_model

CHANNELS = 64


def largest_products(path: Path) -> Path:
    """Write a convolution in eight bits whose values and weights are the largest there are."""
    weights = np.full((8, CHANNELS, 1, 1), 127, np.int8)
    weights[4:] = -127
    weights[::2, ::2] = 0  # every other sum has half the addends
    tensors = {
        "one": np.float32(1),
        "zero": np.uint8(0),
        "none": np.int8(0),
        "large": np.float32(2**14),  # so that sums of 64 × 255 × 127 fit eight bits again
        "middle": np.uint8(128),
        "weights": weights,
    }
    nodes = [
        helper.make_node("QuantizeLinear", ["image", "one", "zero"], ["bytes"]),
        helper.make_node("DequantizeLinear", ["bytes", "one", "zero"], ["values"]),
        helper.make_node("DequantizeLinear", ["weights", "one", "none"], ["kernel"]),
        helper.make_node("Conv", ["values", "kernel"], ["sums"]),
        helper.make_node("QuantizeLinear", ["sums", "large", "middle"], ["small"]),
        helper.make_node("DequantizeLinear", ["small", "large", "middle"], ["map"]),
    ]
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, 8, 8])
        for name, channels in (("image", CHANNELS), ("map", 8))
    ]
    constants = [numpy_helper.from_array(np.asarray(a), name) for name, a in tensors.items()]
    graph = helper.make_graph(nodes, "products", ends[:1], ends[1:], constants)
    model = helper.make_model_gen_version(graph, opset_imports=[helper.make_opsetid("", 17)])
    onnx.save(model, path)
    return path


def test_the_largest_products_of_eight_bits_do_not_overflow(tmp_path: Path) -> None:
    session = open_model(largest_products(tmp_path / "largest.onnx"), 1, "a model")
    (found,) = session.run(None, {"image": np.full((1, CHANNELS, 8, 8), 255, np.float32)})
    half, whole = CHANNELS // 2 * 255 * 127, CHANNELS * 255 * 127
    sums = np.array([half, whole, half, whole, -half, -whole, -half, -whole])
    expected = np.rint(sums / 2**14) * 2**14
    np.testing.assert_array_equal(found, np.broadcast_to(expected[:, None, None], (1, 8, 8, 8)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("processor\t: 0\nflags\t\t: fpu avx512f avx512_vnni rdpid\n", True),
        ("flags\t\t: fpu avx2 avx_vnni\n", True),
        ("flags\t\t: fpu avx2 fma\nmodel name\t: no avx_vnni\n", False),
        ("Features\t: asimd asimddp\n", False),
    ],
)
def test_vnni_is_what_the_kernel_says(tmp_path: Path, text: str, expected: bool) -> None:
    (tmp_path / "cpuinfo").write_text(text, encoding="utf-8")
    assert has_vnni(tmp_path / "cpuinfo") is expected


def test_without_the_kernels_word_there_is_no_vnni(tmp_path: Path) -> None:
    assert not has_vnni(tmp_path / "none")


@pytest.mark.parametrize("model", [BUNDLED_MODEL, BUNDLED_MODEL.with_name("u2netp-wide.onnx")])
def test_threads_change_no_bit_of_a_map_in_eight_bits_or_single_precision(model: Path) -> None:
    photo = np.random.default_rng(0).integers(0, 60, (96, 128, 3), dtype=np.uint8)
    photo[30:70, 40:90] += 150  # a thing, so that maps show something
    photos = [photo, photo[::-1].copy()]
    maps = [SaliencyNetwork(model, threads=n).all_maps(photos, ["a", "b"]) for n in (1, 2, 3)]
    assert np.max(maps[0]) == 1
    for more in maps[1:]:
        np.testing.assert_array_equal(more, maps[0])
