"""Adam over splats, with state that follows them when splats come and go.

Kingma & Ba 2015 with the settings of 3DGS: beta 0.9 and 0.999, epsilon 1e-15, one learning rate
per kind of parameter, one step count for all. Splats that join have moments of zero, splats that
stay keep theirs.
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from mattgs_ops.splat.adam import adam_step
from mattgs_ops.splat.gaussians import SHAPES, Splats
from mattgs_ops.splat.rasterize import Gradients

FIELDS = tuple(SHAPES)
BETAS = (0.9, 0.999)
EPSILON = 1e-15


def select(splats: Splats, index: Tensor) -> Splats:
    """Return the splats of ``index`` [K] int64 (or the true ones of [N] bool), as copies."""
    return Splats(**{name: getattr(splats, name)[index] for name in FIELDS})


def concatenate(first: Splats, second: Splats) -> Splats:
    """Return the splats of ``first`` followed by those of ``second``."""
    return Splats(
        **{name: torch.cat([getattr(first, name), getattr(second, name)]) for name in FIELDS}
    )


class Adam:
    """The optimiser's state: two moments shaped like the splats, and the number of steps."""

    def __init__(self, splats: Splats) -> None:
        self.first = {name: torch.zeros_like(getattr(splats, name)) for name in FIELDS}
        self.second = {name: torch.zeros_like(getattr(splats, name)) for name in FIELDS}
        self.steps = 0

    def step(
        self, splats: Splats, gradients: Gradients, rates: Mapping[str, float], threads: int = 1
    ) -> None:
        """Change ``splats`` in place by one step; ``rates`` per field of the splats."""
        self.steps += 1
        for name in FIELDS:
            adam_step(
                getattr(splats, name),
                getattr(gradients, name),
                self.first[name],
                self.second[name],
                rate=rates[name],
                step=self.steps,
                betas=BETAS,
                epsilon=EPSILON,
                threads=threads,
            )

    def keep(self, index: Tensor) -> None:
        """Follow :func:`select`."""
        for moments in (self.first, self.second):
            for name in FIELDS:
                moments[name] = moments[name][index]

    def join(self, count: int) -> None:
        """Follow :func:`concatenate` with ``count`` new splats."""
        for moments in (self.first, self.second):
            for name in FIELDS:
                old = moments[name]
                moments[name] = torch.cat([old, old.new_zeros((count, *old.shape[1:]))])

    def forget(self, name: str) -> None:
        """Set the moments of one kind of parameter to zero, as after an opacity reset."""
        self.first[name].zero_()
        self.second[name].zero_()
