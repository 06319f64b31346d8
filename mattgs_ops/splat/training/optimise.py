"""Adam over splats, with state that follows them when splats come and go.

Kingma & Ba 2015 with the settings of 3DGS: beta 0.9 and 0.999, epsilon 1e-15, one learning rate
per kind of parameter, one step count for all. Splats that join have moments of zero, splats that
stay keep theirs.
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from mattgs_ops.errors import StageError
from mattgs_ops.splat.gaussians import SHAPES, Splats
from mattgs_ops.splat.memory import Memory, Unshared
from mattgs_ops.splat.rasterize import Rendering, SplatStatistics, checked_pixels, splat_arrays

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

    def descend(
        self,
        rendering: Rendering,
        grad_image: Tensor,
        rates: Mapping[str, float],
        *,
        grad_alpha: Tensor | None = None,
        pixel_map: Tensor | None = None,
        statistics: bool = False,
        penalties: tuple[float, float] = (0.0, 0.0),
        memory: Memory | None = None,
    ) -> SplatStatistics:
        """Go back from a rendering and move its splats by one step, in place.

        As :func:`~mattgs_ops.splat.rasterize.backward` and then a step of Adam, with one learning
        rate per field, but in one pass: gradients never leave the processor's cache. What is above
        the rendering's ``sh_degree`` stays as it is. ``penalties`` are the weights in the loss of
        each splat's opacity and of each of its three scales. Raises :class:`StageError` that names
        the fields whose gradient was not finite; the splats are of no use then.
        """
        splats = rendering.splats
        pixels = checked_pixels(rendering, grad_image, grad_alpha, pixel_map)
        memory = Unshared() if memory is None else memory
        observed = SplatStatistics.taken(memory, len(splats), statistics=statistics)
        self.steps += 1
        broken = rendering.engine.descend(
            splat_arrays(splats),
            *pixels,
            tuple(self.first[name].numpy() for name in FIELDS),
            tuple(self.second[name].numpy() for name in FIELDS),
            [rates[name] for name in FIELDS],
            (*BETAS, EPSILON, *penalties),
            self.steps,
            observed.arrays(),
            statistics,
        )
        if broken:
            names = ", ".join(f"`{name}`" for i, name in enumerate(FIELDS) if broken >> i & 1)
            raise StageError(f"the gradient of {names} is not finite")
        return observed

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
