"""LPIPS against the networks put together from torch's own layers, with random weights."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from mattgs_ops.errors import InputError
from mattgs_ops.score.lpips import Lpips

RNG = np.random.default_rng(6)
TRUTH = RNG.random((70, 66, 3))
IMAGE = np.clip(TRUTH + 0.2 * RNG.normal(size=TRUTH.shape), 0, 1)
ALEX_ENDS, VGG_ENDS = (1, 4, 7, 9, 11), (3, 8, 15, 22, 29)  # the ReLU that each slice ends with


def alexnet() -> nn.Sequential:
    return nn.Sequential(
        *(nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(64, 192, 5, 1, 2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(192, 384, 3, 1, 1), nn.ReLU(), nn.Conv2d(384, 256, 3, 1, 1), nn.ReLU()),
        *(nn.Conv2d(256, 256, 3, 1, 1), nn.ReLU()),
    )


def vgg16() -> nn.Sequential:
    layers: list[nn.Module] = []
    before = 3
    for width, count in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3)):
        for _ in range(count):
            layers += [nn.Conv2d(before, width, 3, 1, 1), nn.ReLU()]
            before = width
        layers.append(nn.MaxPool2d(2, 2))
    return nn.Sequential(*layers[:-1])


def state(network: nn.Sequential, ends: tuple[int, ...]) -> dict[str, torch.Tensor]:
    """Name a network's tensors as the authors' module does, with weights of channels beside."""
    found, start = {}, 0
    for number, end in enumerate(ends):
        for place in range(start, end + 1):
            for name, value in network[place].named_parameters():
                found[f"net.slice{number + 1}.{place}.{name}"] = value.detach()
                channels = value.shape[0]
        found[f"lin{number}.model.1.weight"] = torch.rand(1, channels, 1, 1)
        start = end + 1
    return found


def slow(network: nn.Sequential, ends: tuple[int, ...], weights: dict[str, torch.Tensor]) -> float:
    """Compare pixel by pixel of each layer, eq. 1 of the paper."""
    shift, scale = np.array([-0.030, -0.088, -0.188]), np.array([0.458, 0.448, 0.450])
    layers = []
    for picture in (IMAGE, TRUTH):
        values = torch.from_numpy(((2 * picture - 1 - shift) / scale).transpose(2, 0, 1)[None])
        values, kept = values.float(), []
        for place, layer in enumerate(network):
            values = layer(values)
            if place in ends:
                kept.append(values.detach().numpy()[0])
        layers.append(kept)
    total = 0.0
    for number, (ours, theirs) in enumerate(zip(*layers, strict=True)):
        weight = weights[f"lin{number}.model.1.weight"].numpy()[0, :, 0, 0]
        _, height, width = ours.shape
        distances = []
        for y in range(height):
            for x in range(width):
                a, b = ours[:, y, x], theirs[:, y, x]
                difference = a / np.linalg.norm(a) - b / np.linalg.norm(b)
                distances.append(float((weight * difference**2).sum()))
        total += float(np.mean(distances))
    return total


@pytest.mark.parametrize(("build", "ends"), [(alexnet, ALEX_ENDS), (vgg16, VGG_ENDS)])
def test_distances_are_those_of_the_network_layer_by_layer(
    build: type, ends: tuple[int, ...], tmp_path: Path
) -> None:
    torch.manual_seed(0)
    network = build()
    weights = state(network, ends)
    torch.save(weights | {"scaling_layer.shift": torch.zeros(1)}, tmp_path / "weights.pth")
    found = Lpips.load(tmp_path / "weights.pth")
    assert found.distance(IMAGE, TRUTH) == pytest.approx(slow(network, ends, weights), rel=1e-3)
    assert found.distance(TRUTH, TRUTH) == 0
    assert found.distance(IMAGE, TRUTH) == pytest.approx(found.distance(TRUTH, IMAGE))


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "weights.pth"
    path.write_bytes(b"no weights")
    with pytest.raises(InputError, match=r"weights\.pth: expected weights of LPIPS"):
        Lpips.load(path)
    weights = state(alexnet(), ALEX_ENDS)
    del weights["lin3.model.1.weight"]
    torch.save(weights, path)
    with pytest.raises(InputError, match=r"for AlexNet it lacks lin3\.model\.1\.weight"):
        Lpips.load(path)
    torch.save([1], path)
    with pytest.raises(InputError, match="expected a state dictionary, found list"):
        Lpips.load(path)
