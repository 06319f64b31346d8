"""From a trained network to an ONNX file, and the proof that both compute the same.

The file has one input ``image`` [N, 3, S, S] float32 (see ``preprocess``) and one output
``saliency`` [N, 1, S, S] in 0..1: the fused map after its sigmoid. The number of images is free,
the side is fixed, as in the ONNX files that background-removal tools ship.
"""

import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from mattgs_ops.errors import StageError
from mattgs_ops.segment.network.u2net import U2Net

TOLERANCE = 1e-3  # on probabilities: float32 sums in another order, through a hundred layers
OPSET = 17  # understood by every ONNX Runtime since 1.12


class _Fused(nn.Module):
    def __init__(self, model: U2Net) -> None:
        super().__init__()
        self.model = model

    def forward(self, image: Tensor) -> Tensor:
        return torch.sigmoid(self.model(image)[0])


def export(model: U2Net, path: Path, *, size: int = 320) -> float:
    """Write ``path`` and return the largest difference between torch and ONNX Runtime.

    Raises :class:`StageError` when they differ by more than ``TOLERANCE``.
    """
    fused = _Fused(model).eval().cpu()
    example = torch.zeros(1, 3, size, size)
    with warnings.catch_warnings():
        # the TorchScript exporter is deprecated; its successor needs one more package
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        warnings.filterwarnings("ignore", category=torch.jit._trace.TracerWarning)
        torch.onnx.export(
            fused,
            (example,),
            str(path),
            dynamo=False,
            opset_version=OPSET,
            input_names=["image"],
            output_names=["saliency"],
            dynamic_axes={"image": {0: "images"}, "saliency": {0: "images"}},
        )
    difference = largest_difference(fused, path, size)
    if difference > TOLERANCE:
        raise StageError(
            f"{path}: expected ONNX Runtime to agree with torch within {TOLERANCE}, "
            f"found a difference of {difference:.2g}"
        )
    return difference


@torch.no_grad()
def largest_difference(fused: nn.Module, path: Path, size: int) -> float:
    """Compare both on two images of noise."""
    import onnxruntime

    noise = np.random.default_rng(0).normal(size=(2, 3, size, size)).astype(np.float32)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, ["CPUExecutionProvider"])
    (found,) = session.run(None, {"image": noise})
    expected = fused(torch.from_numpy(noise)).numpy()
    return float(np.abs(found - expected).max())
