"""Per-photo exposure: an affine change of colour that training finds for each photo.

Photos of one object differ in brightness and white balance, from automatic exposure and flashes.
Where the splats must explain that, they do so with clouds in front of single cameras. As in the
original 3DGS release ("exposure compensation"), each training photo has a matrix [3, 4], identity
at first, that changes the rendering's colours before they are compared with that photo.

What is changed is the splats' own colour, not what lies behind them: with the blended colour ``C``
over a background ``b`` and opacity ``a``, ``P = C - (1 - a) b`` is the splats' share and the photo
is compared with ``E P + a t + (1 - a) b``. So the white of a cut-out stays white.

Splats and matrices could drift apart together: brighter splats and darker matrices look the same.
After every step the mean of all matrices is therefore set to the identity again, so that splats
rendered without a matrix, as test views are, show the mean exposure of the training photos.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from mattgs_ops.splat.photos import Colour
from mattgs_ops.splat.rasterize import Rendering
from mattgs_ops.splat.torch_threads import torch_threads

FILE = "exposures.json"
# as in the original release's arguments: exposure_lr_init and exposure_lr_final
RATE, RATE_FINAL = 0.01, 0.001
# Adam's settings there are torch's defaults
BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8


@dataclass(frozen=True)
class ExposureGradients:
    """dL/d rendering [H, W, 3], dL/d alpha [H, W] and dL/d matrix [3, 4]."""

    image: Tensor
    alpha: Tensor
    matrix: Tensor

    def with_alpha(self, other: Tensor | None) -> Tensor:
        """Return dL/d alpha with another loss's added, where there is one."""
        return self.alpha if other is None else self.alpha + other


@dataclass
class Exposures:
    """One matrix per training view and Adam's state, which counts each view's own steps.

    ``matrices``, ``first`` and ``second`` are [V, 3, 4], ``steps`` [V]; ``iterations`` is the
    training's length.
    """

    matrices: Tensor
    first: Tensor
    second: Tensor
    steps: Tensor
    iterations: int

    @classmethod
    def identity(cls, views: int, iterations: int) -> "Exposures":
        """Begin with no change of colour."""
        zero = torch.zeros(views, 3, 4)
        return cls(_identity(views), zero, zero.clone(), torch.zeros(views), iterations)

    def tensors(self) -> dict[str, Tensor]:
        """Return what a checkpoint holds, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Tensor)}

    def apply(self, view: int, rendering: Rendering, background: Colour) -> Tensor:
        """Return the rendering as the view's photo shows it, [H, W, 3]."""
        matrix, offset = self.matrices[view, :, :3], self.matrices[view, :, 3]
        alpha = rendering.alpha
        behind = (1 - alpha)[..., None] * torch.tensor(background)
        shown = (rendering.image - behind) @ matrix.T
        return shown.add_(alpha[..., None] * offset).add_(behind)

    def gradients(
        self, view: int, rendering: Rendering, background: Colour, grad: Tensor
    ) -> "ExposureGradients":
        """Turn dL/d(what :meth:`apply` returned) [H, W, 3] into gradients of its three inputs."""
        matrix, offset = self.matrices[view, :, :3], self.matrices[view, :, 3]
        colour, alpha = torch.tensor(background), rendering.alpha
        own = rendering.image - (1 - alpha)[..., None] * colour
        flat = grad.reshape(-1, 3)
        with torch_threads(1):  # more would add in another order, over pixels and over channels
            grad_matrix = torch.cat(
                [flat.T @ own.reshape(-1, 3), flat.T @ alpha.reshape(-1, 1)], dim=1
            )
            grad_alpha = grad @ (matrix @ colour + offset - colour)
            return ExposureGradients(grad @ matrix, grad_alpha, grad_matrix)

    def descend(
        self, view: int, rendering: Rendering, background: Colour, grad: Tensor, step: int
    ) -> "ExposureGradients":
        """Move one view's matrix by Adam, then set the mean of all to the identity again.

        ``step`` of the training decides the rate. Returns what :meth:`gradients` gives, of the
        matrix before it moved.
        """
        found = self.gradients(view, rendering, background, grad)
        self._move(view, found.matrix, exposure_rate(step, self.iterations))
        return found

    def _move(self, view: int, grad: Tensor, rate: float) -> None:
        self.steps[view] += 1
        step = float(self.steps[view])
        first, second = self.first[view], self.second[view]
        first.lerp_(grad, 1 - BETA1)
        second.mul_(BETA2).addcmul_(grad, grad, value=1 - BETA2)
        scale = (second / (1 - BETA2**step)).sqrt_().add_(EPSILON)
        self.matrices[view].addcdiv_(first, scale, value=-rate / (1 - BETA1**step))
        self.matrices -= self.matrices.mean(dim=0) - _identity(1)[0]

    def save(self, names: Sequence[str], folder: Path) -> None:
        """Write ``exposures.json``: the spread, and each photo's matrix by its view's name."""
        photos = dict(zip(names, self.matrices.tolist(), strict=True))
        document = {"spread": self.spread(), "photos": photos}
        text = json.dumps(document, indent=1, sort_keys=True)
        (folder / FILE).write_text(text + "\n", encoding="utf-8")

    def spread(self) -> float:
        """Return the largest factor in brightness between two photos.

        A photo's brightness is what its matrix makes of mid-grey, the mean over channels.
        """
        grey = (self.matrices[:, :, :3].sum(dim=2) * 0.5 + self.matrices[:, :, 3]).mean(dim=1)
        return float(grey.max() / grey.min().clamp_min(1e-3))


def as_photographed(
    exposures: Exposures | None, view: int, rendering: Rendering, background: Colour
) -> Tensor:
    """Return the image that a view's photo is compared with [H, W, 3], in its exposure if any."""
    return rendering.image if exposures is None else exposures.apply(view, rendering, background)


def exposure_rate(step: int, iterations: int) -> float:
    """Return the learning rate of a step, from 1: it falls exponentially from first to last."""
    share = min(max(step / iterations, 0.0), 1.0)
    return float(RATE * (RATE_FINAL / RATE) ** share)


def _identity(views: int) -> Tensor:
    return torch.eye(3, 4).repeat(views, 1, 1)
