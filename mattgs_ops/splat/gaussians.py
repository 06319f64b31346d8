"""The parameters of a set of splats, as they are optimised.

Activations are applied by the engine: scales are ``exp(log_scales)``, opacities
``sigmoid(opacity_logits)``, rotations the normalised quaternions (w, x, y, z). Colour is
``max(SH + 0.5, 0)`` with real spherical harmonics up to degree 3 (Kerbl et al. 2023).
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from mattgs_ops.errors import InputError
from mattgs_ops.splat.harmonics import SH_REST

SHAPES: dict[str, tuple[int, ...]] = {
    "means": (3,),
    "log_scales": (3,),
    "quaternions": (4,),
    "opacity_logits": (),
    "sh_dc": (3,),
    "sh_rest": (SH_REST, 3),
}
FLOATS_PER_SPLAT = 59  # the sum of the above


@dataclass
class Splats:
    """N splats: float32 tensors on the CPU, contiguous."""

    means: Tensor  # [N, 3] world
    log_scales: Tensor  # [N, 3]
    quaternions: Tensor  # [N, 4] wxyz, any length
    opacity_logits: Tensor  # [N]
    sh_dc: Tensor  # [N, 3]
    sh_rest: Tensor  # [N, 15, 3]

    def __len__(self) -> int:
        return int(self.means.shape[0])

    def items(self) -> Iterator[tuple[str, Tensor]]:
        """Yield (name, tensor) in the order of the fields."""
        for field in fields(self):
            yield field.name, getattr(self, field.name)

    @classmethod
    def zeros(cls, count: int) -> "Splats":
        """Return ``count`` splats with every parameter 0 (not a valid rotation: set one)."""
        return cls(
            **{
                name: torch.zeros((count, *shape), dtype=torch.float32)
                for name, shape in SHAPES.items()
            }
        )

    def check(self) -> None:
        """Raise :class:`InputError` naming the first field that is not as documented."""
        count = len(self)
        for name, tensor in self.items():
            expected = (count, *SHAPES[name])
            if tuple(tensor.shape) != expected:
                raise InputError(
                    f"splats.{name}: expected shape {expected}, found {tuple(tensor.shape)}"
                )
            if tensor.dtype != torch.float32 or tensor.device.type != "cpu":
                raise InputError(
                    f"splats.{name}: expected float32 on the CPU, "
                    f"found {tensor.dtype} on {tensor.device}"
                )
            if not tensor.is_contiguous():
                raise InputError(f"splats.{name}: expected a contiguous tensor, found strides")
