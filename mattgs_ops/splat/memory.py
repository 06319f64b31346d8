"""Memory that a training loop uses again in every step.

A step needs fresh tensors of some megabytes: the gradients, the rendering, its target. Freed and
allocated anew, their pages go back to the operating system and come again zeroed, one fault per
4 KiB, which can cost more than the computation that fills them (``benchmarks/engine.py`` prints
both). Nothing here grows from step to step: a tensor is allocated anew only when more splats or
pixels are asked for than ever before, then with room to spare.
"""

import math

import torch
from torch import Tensor

ROOM = 1.5  # of what is asked for: densification asks for a little more every time


class Memory:
    """Float32 tensors by name; what was last taken under a name is overwritten by the next."""

    def __init__(self) -> None:
        self._kept: dict[str, Tensor] = {}

    def take(self, name: str, *shape: int) -> Tensor:
        """Return a contiguous tensor of ``shape``, its content undefined."""
        size = math.prod(shape)
        kept = self._kept.get(name)
        if kept is None or len(kept) < size:
            kept = torch.empty(
                size if kept is None else math.ceil(ROOM * size), dtype=torch.float32
            )
            self._kept[name] = kept
        return kept[:size].view(shape)


class Unshared(Memory):
    """Fresh tensors every time, for callers that keep what they are given."""

    def take(self, name: str, *shape: int) -> Tensor:  # noqa: ARG002 - nothing is kept
        """Return a new tensor of ``shape``, its content undefined."""
        return torch.empty(shape, dtype=torch.float32)
