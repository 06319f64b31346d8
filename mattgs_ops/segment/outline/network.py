"""The outline's network: photo and coarse map in, the object's share of each pixel out.

A U-Net (Ronneberger et al. 2015) that works at half the photo's resolution and below, and adds the
last fine step at the full one: some 11,000 multiply-adds a pixel.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

WIDTHS = (24, 32, 48, 64)  # channels at 1/2, 1/4, 1/8 and 1/16 of the photo's resolution
FINE = 12  # channels at the photo's own resolution
MULTIPLE = 16  # of pixels that height and width have to be


class OutlineNet(nn.Module):
    """Photo in [0, 1] and map in [0, 1] [B, 4, H, W] to logits [B, 1, H, W].

    Height and width are multiples of ``MULTIPLE``. The answer is added to the map's logits, so that
    an untrained network leaves it as it is.
    """

    def __init__(self) -> None:
        super().__init__()
        before = (16, *WIDTHS[:-1])
        self.down = nn.ModuleList(_twice(a, b) for a, b in zip(before, WIDTHS, strict=True))
        self.up = nn.ModuleList(_twice(a + b, a) for a, b in pairwise(WIDTHS))
        first = nn.Conv2d(WIDTHS[0] // 4 + 4, FINE, 3, padding=1)
        answer = nn.Conv2d(FINE, 1, 3, padding=1)
        for parameter in answer.parameters():
            nn.init.zeros_(parameter)
        self.fine = nn.Sequential(first, nn.ReLU(inplace=True), answer)

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        seen = []
        y = functional.pixel_unshuffle(x - 0.5, 2)
        for level, block in enumerate(self.down):
            y = block(functional.max_pool2d(y, 2) if level else y)
            seen.append(y)
        for level in range(len(self.up) - 1, -1, -1):
            y = functional.interpolate(y, scale_factor=2.0, mode="bilinear", align_corners=False)
            y = self.up[level](torch.cat([seen[level], y], dim=1))
        y = torch.cat([functional.pixel_shuffle(y, 2), x - 0.5], dim=1)
        share = x[:, 3:].clamp(0.02, 0.98)
        logits: Tensor = self.fine(y) + torch.log(share / (1 - share))
        return logits


def _twice(before: int, after: int) -> nn.Sequential:
    """Two convolutions with batch normalisation."""
    layers: list[nn.Module] = []
    for channels in (before, after):
        layers += [
            nn.Conv2d(channels, after, 3, padding=1, bias=False),
            nn.BatchNorm2d(after),
            nn.ReLU(inplace=True),
        ]
    return nn.Sequential(*layers)
