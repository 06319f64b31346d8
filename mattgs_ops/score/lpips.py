"""LPIPS (Zhang et al. 2018), with a file of weights that the user names; none comes with this.

The file is the state of the authors' PyTorch module, version 0.1, with AlexNet or VGG16 as its
network; it holds the network and the five layers that weigh its channels::

    torch.save(lpips.LPIPS(net="alex").state_dict(), "lpips-alex.pth")

Only tensors are read from it, never code.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from mattgs_ops.errors import InputError

Image = NDArray[np.floating]

# Of the authors' scaling layer: ImageNet's mean and deviation, for inputs in [-1, 1]
SHIFT, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
TINY = 1e-10  # added to a feature's length before it is divided by it, as the authors do


@dataclass(frozen=True)
class Slice:
    """A network's layers up to a compared one: pooling (side, step), then convolutions.

    ``convolutions`` are places in torchvision's list of layers, with stride and padding.
    """

    pooling: tuple[int, int] | None
    convolutions: tuple[tuple[int, int, int], ...]


def _slice(
    pooling: tuple[int, int] | None, *places: int, stride: int = 1, padding: int = 1
) -> Slice:
    return Slice(pooling, tuple((place, stride, padding) for place in places))


NETWORKS = {
    "AlexNet": (
        _slice(None, 0, stride=4, padding=2),
        _slice((3, 2), 3, padding=2),
        _slice((3, 2), 6),
        _slice(None, 8),
        _slice(None, 10),
    ),
    "VGG16": (
        _slice(None, 0, 2),
        _slice((2, 2), 5, 7),
        _slice((2, 2), 10, 12, 14),
        _slice((2, 2), 17, 19, 21),
        _slice((2, 2), 24, 26, 28),
    ),
}


@dataclass(frozen=True)
class Lpips:
    """A network and its weights, ready to compare images."""

    network: str
    weights: Mapping[str, Tensor]

    @classmethod
    def load(cls, path: Path) -> "Lpips":
        """Read a file of weights; raises :class:`InputError` naming it and what it lacks."""
        try:
            found = torch.load(path, map_location="cpu", weights_only=True)
        except Exception as error:  # torch has many, and none of its own
            raise InputError(f"{path}: expected weights of LPIPS: {error}") from error
        if not isinstance(found, dict):
            raise InputError(f"{path}: expected a state dictionary, found {type(found).__name__}")
        lacking = {name: [k for k in _keys(name) if k not in found] for name in NETWORKS}
        network = min(lacking, key=lambda name: len(lacking[name]))
        if lacking[network]:
            raise InputError(
                f"{path}: expected LPIPS of {' or '.join(NETWORKS)}; for {network} it lacks "
                f"{', '.join(lacking[network][:3])}"
            )
        return cls(network, {key: found[key].float() for key in _keys(network)})

    def distance(self, image: Image, truth: Image) -> float:
        """Return LPIPS of two images [H, W, 3] in [0, 1]; 0 for the same, more for others."""
        if image.shape != truth.shape or image.ndim != 3:
            raise InputError(
                f"expected two images of one size, found {image.shape} and {truth.shape}"
            )
        total = 0.0
        with torch.no_grad():
            pairs = zip(self._features(image), self._features(truth), strict=True)
            for number, (ours, theirs) in enumerate(pairs):
                weight = self.weights[f"lin{number}.model.1.weight"]
                total += float(functional.conv2d((ours - theirs) ** 2, weight).mean())
        return total

    def _features(self, image: Image) -> list[Tensor]:
        """Return the five compared layers [1, C, H, W], each pixel's feature of length 1."""
        values = torch.from_numpy(np.ascontiguousarray(image, dtype=np.float32))
        values = 2 * values.permute(2, 0, 1)[None] - 1
        values = (values - _channels(SHIFT)) / _channels(SCALE)
        found = []
        for number, part in enumerate(NETWORKS[self.network], start=1):
            if part.pooling is not None:
                side, step = part.pooling
                values = functional.max_pool2d(values, side, step)
            for place, stride, padding in part.convolutions:
                key = f"net.slice{number}.{place}"
                weight, bias = self.weights[f"{key}.weight"], self.weights[f"{key}.bias"]
                values = functional.conv2d(values, weight, bias, stride, padding).relu()
            length = values.square().sum(dim=1, keepdim=True).sqrt()
            found.append(values / (length + TINY))
        return found


def _keys(network: str) -> list[str]:
    """Return the names of all tensors that a network's LPIPS has."""
    keys = []
    for number, part in enumerate(NETWORKS[network]):
        for place, _, _ in part.convolutions:
            keys += [f"net.slice{number + 1}.{place}.{kind}" for kind in ("weight", "bias")]
        keys.append(f"lin{number}.model.1.weight")
    return keys


def _channels(values: tuple[float, ...]) -> Tensor:
    return torch.tensor(values)[None, :, None, None]
