"""From a trained network to an ONNX file, and the proof that both compute the same.

The file has one input ``image`` [N, 3, S, S] float32 (see ``preprocess``) and one output
``saliency`` [N, 1, S, S] in 0..1: the fused map after its sigmoid. The number of images is free,
the side is fixed, as in the ONNX files that background-removal tools ship.
"""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from mattgs_ops.segment.network.u2net import U2Net
from mattgs_ops.segment.onnx_files.onnx_file import write_model


class _Fused(nn.Module):
    def __init__(self, model: U2Net) -> None:
        super().__init__()
        self.model = model

    def forward(self, image: Tensor) -> Tensor:
        return torch.sigmoid(self.model(image)[0])


def export(model: U2Net, path: Path, *, size: int = 320) -> float:
    """Write ``path``; return the largest difference between torch and ONNX Runtime on noise.

    Raises :class:`StageError` when they differ by more than ``onnx_file.TOLERANCE``.
    """
    noise = np.random.default_rng(0).normal(size=(2, 3, size, size)).astype(np.float32)
    return write_model(_Fused(model), path, ("image", "saliency"), noise, {0: "images"})
