"""A saliency network of one block: every kind of layer that U²-Net has, a tenth of the layers.

What is done to an ONNX file goes by its layers, one by one: more of a kind only take longer.
"""

from pathlib import Path

import torch
from torch import Tensor, nn

from mattgs_ops.segment.network.export import export
from mattgs_ops.segment.network.u2net import ResidualUBlock, U2Net


class _OneBlock(U2Net):
    def __init__(self) -> None:
        super(U2Net, self).__init__()
        self.block = ResidualUBlock(4, 3, 64, 64)
        self.outconv = nn.Conv2d(64, 1, 3, padding=1)

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        """[B, 3, H, W] to one logit map [B, 1, H, W]."""
        return (self.outconv(self.block(x)),)


def write_network(path: Path, size: int, seed: int, gain: float) -> Path:
    """Write an untrained network; ``gain`` raises its last layer, without which maps are flat."""
    torch.manual_seed(seed)
    model = _OneBlock().eval()
    with torch.no_grad():
        model.outconv.weight.mul_(gain)
    export(model, path, size=size)
    return path
