"""U²-Net (Qin et al., "U²-Net: Going deeper with nested U-structure…", Pattern Recognition 2020).

Two sizes: the full network (44.0 M parameters) and U²-NetP (1.1 M). A network takes images
[B, 3, H, W] float32, divided by their maximum and normalised with ImageNet's mean and deviation,
and returns seven maps [B, 1, H, W] of **logits**: the fused one first, then side outputs 1 to 6.
Their sigmoid is the probability of "object". H and W are free; 32 is the smallest that the five
poolings leave anything of.

Parameters carry the names of the public release (``stage1.rebnconvin.conv_s1.weight`` …
``outconv.bias``), so that its ``u2net.pth`` and ``u2netp.pth`` load with ``strict=True``.
"""

from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from mattgs_ops.segment import training_state

Variant = Literal["u2net", "u2netp"]

# (block height, or 0 for the dilated RSU-4F; channels in, inside, out), after the paper's fig. 5
_Spec = tuple[int, int, int, int]
_ENCODER: dict[Variant, tuple[_Spec, ...]] = {
    "u2net": (
        (7, 3, 32, 64),
        (6, 64, 32, 128),
        (5, 128, 64, 256),
        (4, 256, 128, 512),
        (0, 512, 256, 512),
        (0, 512, 256, 512),
    ),
    "u2netp": ((7, 3, 16, 64), *((h, 64, 16, 64) for h in (6, 5, 4, 0, 0))),
}
_DECODER: dict[Variant, tuple[_Spec, ...]] = {  # stages 1d to 5d
    "u2net": (
        (7, 128, 16, 64),
        (6, 256, 32, 64),
        (5, 512, 64, 128),
        (4, 1024, 128, 256),
        (0, 1024, 256, 512),
    ),
    "u2netp": tuple((h, 128, 16, 64) for h in (7, 6, 5, 4, 0)),
}


class ConvBnRelu(nn.Module):
    """3×3 convolution (dilated), batch normalisation, ReLU; the size stays."""

    def __init__(self, channels_in: int, channels_out: int, dilation: int = 1) -> None:
        super().__init__()
        self.conv_s1 = nn.Conv2d(channels_in, channels_out, 3, padding=dilation, dilation=dilation)
        self.bn_s1 = nn.BatchNorm2d(channels_out)

    def forward(self, x: Tensor) -> Tensor:
        """[B, in, H, W] to [B, out, H, W]."""
        out: Tensor = functional.relu(self.bn_s1(self.conv_s1(x)), inplace=True)
        return out


class ResidualUBlock(nn.Module):
    """RSU-L: a small U-Net of height L whose output is added to its own input features.

    ``height`` 0 is RSU-4F, which widens its view by dilation (1, 2, 4, 8) instead of by pooling.
    """

    def __init__(self, height: int, channels_in: int, inside: int, channels_out: int) -> None:
        super().__init__()
        self.pooled = height > 0
        self.depth = depth = height or 4
        dilations = [1] * (depth - 1) + [2] if self.pooled else [2**i for i in range(depth)]
        self.rebnconvin = ConvBnRelu(channels_in, channels_out)
        for i, dilation in enumerate(dilations, start=1):
            block = ConvBnRelu(channels_out if i == 1 else inside, inside, dilation)
            self.add_module(f"rebnconv{i}", block)
        for i in range(depth - 1, 0, -1):
            out = channels_out if i == 1 else inside
            dilation = 1 if self.pooled else dilations[i - 1]
            self.add_module(f"rebnconv{i}d", ConvBnRelu(2 * inside, out, dilation))

    def forward(self, x: Tensor) -> Tensor:
        """[B, in, H, W] to [B, out, H, W]."""
        entry: Tensor = self.rebnconvin(x)
        level, skips = entry, []
        for i in range(1, self.depth):
            if i > 1 and self.pooled:
                level = halve(level)
            level = self.get_submodule(f"rebnconv{i}")(level)
            skips.append(level)
        level = self.get_submodule(f"rebnconv{self.depth}")(level)
        for i in range(self.depth - 1, 0, -1):
            skip = skips[i - 1]
            level = self.get_submodule(f"rebnconv{i}d")(torch.cat((enlarge(level, skip), skip), 1))
        joined: Tensor = entry + level
        return joined


class U2Net(nn.Module):
    """The network; ``variant`` is ``u2net`` or ``u2netp``."""

    def __init__(self, variant: Variant = "u2netp") -> None:
        super().__init__()
        self.variant = variant
        encoder, decoder = _ENCODER[variant], _DECODER[variant]
        for i, spec in enumerate(encoder, start=1):
            self.add_module(f"stage{i}", ResidualUBlock(*spec))
        for i in range(len(decoder), 0, -1):
            self.add_module(f"stage{i}d", ResidualUBlock(*decoder[i - 1]))
        sources = [spec[3] for spec in decoder] + [encoder[-1][3]]
        for i, channels in enumerate(sources, start=1):
            self.add_module(f"side{i}", nn.Conv2d(channels, 1, 3, padding=1))
        self.outconv = nn.Conv2d(len(sources), 1, 1)

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        """[B, 3, H, W] to seven logit maps [B, 1, H, W]: fused, side 1, …, side 6."""
        levels = []
        for i in range(1, 7):
            x = self.get_submodule(f"stage{i}")(halve(x) if i > 1 else x)
            levels.append(x)
        decoded = [x]  # from the deepest level up
        for i in range(5, 0, -1):
            skip = levels[i - 1]
            joined = torch.cat((enlarge(decoded[-1], skip), skip), 1)
            decoded.append(self.get_submodule(f"stage{i}d")(joined))
        first = self.get_submodule("side1")(decoded[5])
        deeper = [
            enlarge(self.get_submodule(f"side{i}")(decoded[6 - i]), first) for i in range(2, 7)
        ]
        fused = self.outconv(torch.cat((first, *deeper), 1))
        return (fused, first, *deeper)


def halve(x: Tensor) -> Tensor:
    """Maximum over 2×2 pixels; odd sizes round up."""
    return functional.max_pool2d(x, 2, stride=2, ceil_mode=True)


def enlarge(x: Tensor, like: Tensor) -> Tensor:
    """Bilinear to the height and width of ``like``."""
    return functional.interpolate(x, size=like.shape[2:], mode="bilinear", align_corners=False)


def load_weights(model: U2Net, path: Path) -> None:
    """Load a ``.pth`` of the public release's form, strictly.

    Raises :class:`InputError` naming the file when it cannot be read or holds other layers.
    """
    training_state.load_weights(model, path, model.variant)
