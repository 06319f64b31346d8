"""Several saliency networks as one ONNX file: each is asked, and the mean of their maps is given.

The file has one input ``image`` [N, 3, S, S] float32, S the largest side of the networks', a first
output ``saliency`` [N, 1, S, S] in 0..1, and what each network says by itself in ``saliency/1``,
``saliency/2``, … Inside, the image is resized to each network's side; each
map is stretched to 0..1, as ``saliency.stretched`` does it, resized to S, and the mean is taken
(an ensemble by averaging: Hansen and Salamon 1990). Networks in eight bits (``onnx_files``)
stay as they are. Weights of others are stored in half precision and computed with in single
precision, so that two networks need the room of one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, compose, helper, numpy_helper

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.segment.network.saliency import LEAST_CONTRAST, SALIENCY, SaliencyNetwork, stretched
from mattgs_ops.segment.onnx_files.onnx_file import OPSET

# on probabilities: half precision keeps 11 bits of a weight; through the hundred layers of the
# bundled networks that became 0.0007, which leaves room for other networks
TOLERANCE = 0.01
IMAGE = "image"
QUANTIZED = "QuantizeLinear"  # a node that only networks in eight bits have
EACH_MAP = [1, 2, 3]  # the axes of one map


@dataclass(frozen=True)
class _Member:
    """A network of the ensemble; ``network`` has checked that the file is one."""

    network: SaliencyNetwork
    model: ModelProto

    @property
    def side(self) -> int:
        return self.network.width


def combine(paths: Sequence[Path], out: Path) -> float:
    """Write the ensemble of the networks at ``paths`` to ``out``.

    Returns the largest difference to the mean of the files' own maps, on two images of noise.
    Raises :class:`InputError` for fewer than two files, one that is no saliency network, has no
    fixed square side or another opset than ``export``'s; :class:`StageError` when the difference
    is above ``TOLERANCE``.
    """
    if len(paths) < 2:
        raise InputError(f"expected at least two ONNX files, found {len(paths)}")
    members = [_member(path) for path in paths]
    side = max(member.side for member in members)
    model = _model(_graph(members, side))
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, out)
    difference = _largest_difference(members, out, side)
    if difference > TOLERANCE:
        raise StageError(
            f"{out}: expected the mean of the networks' maps within {TOLERANCE}, "
            f"found a difference of {difference:.2g}"
        )
    return difference


def _member(path: Path) -> _Member:
    network = SaliencyNetwork(path)
    model = onnx.load(path)
    sides = [d.dim_value for d in model.graph.input[0].type.tensor_type.shape.dim][2:]
    if sides[0] <= 0 or sides[0] != sides[1]:
        raise InputError(f"{path}: expected an input of a fixed square side, found {sides}")
    opsets = {opset.domain: opset.version for opset in model.opset_import}
    if opsets.get("") != OPSET:
        raise InputError(f"{path}: expected ONNX's opset {OPSET}, found {opsets.get('')}")
    return _Member(network, model)


def _model(graph: GraphProto) -> ModelProto:
    opset = helper.make_opsetid("", OPSET)
    return helper.make_model_gen_version(graph, opset_imports=[opset], producer_name="mattgs")


def _graph(members: Sequence[_Member], side: int) -> GraphProto:
    nodes: list[NodeProto] = []
    tensors: list[TensorProto] = []
    maps: list[str] = []
    for number, member in enumerate(members):
        own = compose.add_prefix(member.model, f"n{number}/").graph
        asked, said = own.input[0].name, own.output[0].name
        nodes += _resized(IMAGE, asked, channels=3, side=member.side, tensors=tensors)
        if any(node.op_type == QUANTIZED for node in own.node):
            tensors.extend(own.initializer)
        else:
            for weights in own.initializer:
                nodes += _halved(weights, tensors)
        nodes += own.node
        nodes += _stretched(said, f"{said}/stretched", tensors)
        nodes += _resized(
            f"{said}/stretched", f"{said}/resized", channels=1, side=side, tensors=tensors
        )
        maps.append(f"{SALIENCY}/{number + 1}")
        nodes.append(_clipped(f"{said}/resized", maps[-1], tensors))
    nodes.append(helper.make_node("Mean", maps, [SALIENCY]))

    def images(name: str, channels: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(
            name, TensorProto.FLOAT, ["images", channels, side, side]
        )

    outputs = [images(name, 1) for name in (SALIENCY, *maps)]
    return helper.make_graph(nodes, "mean of saliency maps", [images(IMAGE, 3)], outputs, tensors)


def _constant(name: str, values: NDArray[np.generic], tensors: list[TensorProto]) -> str:
    tensors.append(numpy_helper.from_array(values, name))
    return name


def _resized(
    source: str, target: str, *, channels: int, side: int, tensors: list[TensorProto]
) -> list[NodeProto]:
    """As OpenCV's ``resize``: images bilinear, maps cubic; the number of images is free."""
    shape = _constant(f"{target}/shape", np.array([channels, side, side], np.int64), tensors)
    count, sizes = f"{target}/count", f"{target}/sizes"
    return [
        helper.make_node("Shape", [source], [count], start=0, end=1),
        helper.make_node("Concat", [count, shape], [sizes], axis=0),
        helper.make_node(
            "Resize",
            [source, "", "", sizes],
            [target],
            mode="cubic" if channels == 1 else "linear",
            coordinate_transformation_mode="half_pixel",
        ),
    ]


def _clipped(source: str, target: str, tensors: list[TensorProto]) -> NodeProto:
    """Bring what cubic interpolation overshoots back to 0..1."""
    bounds = [
        _constant(f"{source}/{bound}", np.array(value, np.float32), tensors)
        for bound, value in (("zero", 0), ("one", 1))
    ]
    return helper.make_node("Clip", [source, *bounds], [target])


def _halved(weights: TensorProto, tensors: list[TensorProto]) -> list[NodeProto]:
    """Store single-precision weights in half precision; other tensors stay as they are."""
    values = numpy_helper.to_array(weights)
    half = values.astype(np.float16) if values.dtype == np.float32 else values
    if values.dtype != np.float32 or not np.isfinite(half).all():
        tensors.append(weights)
        return []
    stored = _constant(f"{weights.name}/half", half, tensors)
    return [helper.make_node("Cast", [stored], [weights.name], to=TensorProto.FLOAT)]


def _stretched(source: str, target: str, tensors: list[TensorProto]) -> list[NodeProto]:
    """Min–max each map to 0..1; one that is flatter than ``LEAST_CONTRAST`` becomes 0."""
    least = _constant(f"{target}/least", np.array(LEAST_CONTRAST, np.float32), tensors)
    zero = _constant(f"{target}/zero", np.array(0, np.float32), tensors)
    low, high, spread, above, safe, shows, scaled = (
        f"{target}/{part}" for part in ("low", "high", "spread", "above", "safe", "shows", "scaled")
    )
    return [
        helper.make_node("ReduceMin", [source], [low], axes=EACH_MAP),
        helper.make_node("ReduceMax", [source], [high], axes=EACH_MAP),
        helper.make_node("Sub", [high, low], [spread]),
        helper.make_node("Sub", [source, low], [above]),
        helper.make_node("Max", [spread, least], [safe]),
        helper.make_node("Div", [above, safe], [scaled]),
        helper.make_node("GreaterOrEqual", [spread, least], [shows]),
        helper.make_node("Where", [shows, scaled, zero], [target]),
    ]


def _largest_difference(members: Sequence[_Member], path: Path, side: int) -> float:
    noise = np.random.default_rng(0).normal(size=(2, 3, side, side)).astype(np.float32)
    found = SaliencyNetwork(path).raw_maps(noise)
    expected = np.mean([_asked(member.network, noise) for member in members], axis=0)
    return float(np.abs(found - expected).max())


def _asked(network: SaliencyNetwork, images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Ask a network of another side for its stretched maps [N, 1, S, S], S that of ``images``."""
    side, own = images.shape[-1], (network.width, network.height)
    resized = [cv2.resize(image.transpose(1, 2, 0), own) for image in images]
    maps = network.raw_maps(np.stack([np.asarray(one).transpose(2, 0, 1) for one in resized]))
    return np.stack([stretched(one, side, side, str(network.path)) for one in maps])
