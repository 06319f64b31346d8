"""An ONNX network in eight bits: 0.4 of the time on CPUs with VNNI, a third of the room.

Weights are rounded per output channel, values per tensor on the range that they had on given
inputs (Jacob et al., Quantization and Training of Neural Networks for Efficient Integer-Arithmetic-
Only Inference, CVPR 2018; computed by ONNX Runtime's static quantisation). The first and the last
convolution stay in single precision: little is computed there, and all detail passes through them.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import GraphProto
from onnxruntime.quantization import (
    CalibrationDataReader,
    QuantFormat,
    QuantType,
    quant_pre_process,
    quantize_static,
)

from mattgs_ops.errors import StageError
from mattgs_ops.segment.onnx_files.onnx_file import open_model

# Mean difference of maps, of probability. The bundled networks came to 0.002 to 0.003 on the inputs
# that they were fitted to (the command prints it); one that is ten times worse is broken.
TOLERANCE = 0.03
LEAST_INPUTS = 2  # one would leave each range to a single picture


class _Inputs(CalibrationDataReader):  # type: ignore[misc]  # ONNX Runtime has no types
    def __init__(self, name: str, inputs: NDArray[np.float32]) -> None:
        self._left: Iterator[NDArray[np.float32]] = iter(inputs)
        self._name = name

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        """Return the next input as the network takes it, None after the last."""
        values = next(self._left, None)
        return None if values is None else {self._name: values[None]}


def quantize(path: Path, inputs: NDArray[np.float32], out: Path) -> float:
    """Write the network at ``path``, of one input and maps in 0..1, in eight bits to ``out``.

    ``inputs`` [N, C, H, W] say which range each value has: of images like those that the network
    was trained on, never of those that it is judged by. Returns the mean absolute difference that
    it makes to the maps of them. Raises :class:`InputError` for a file that is no network, and
    :class:`StageError` for a difference above ``TOLERANCE``.
    """
    if len(inputs) < LEAST_INPUTS:
        raise ValueError(f"inputs: expected at least {LEAST_INPUTS}, found {len(inputs)}")
    before = open_model(path, 1, "a network")
    name = before.get_inputs()[0].name
    with tempfile.TemporaryDirectory() as folder:
        shaped = Path(folder) / "shaped.onnx"
        quant_pre_process(path, shaped, skip_symbolic_shape=True)
        quantize_static(
            shaped,
            out,
            _Inputs(name, inputs),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            nodes_to_exclude=sorted(outer_convolutions(onnx.load(shaped).graph)),
        )
    after = open_model(out, 1, "a network")
    pairs = ([net.run(None, {name: one[None]})[0] for net in (before, after)] for one in inputs)
    difference = float(np.mean([np.abs(a - b).mean() for a, b in pairs]))
    if difference > TOLERANCE:
        raise StageError(
            f"{out}: expected maps within {TOLERANCE} of {path}'s on average, "
            f"found a difference of {difference:.2g}"
        )
    return difference


def outer_convolutions(graph: GraphProto) -> set[str]:
    """Return the names of a graph's first and last convolution, as they are computed."""
    convolutions = [node.name for node in graph.node if node.op_type == "Conv"]
    return {convolutions[0], convolutions[-1]}
