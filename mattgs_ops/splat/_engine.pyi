"""Types of the compiled engine; see ``_kernels/module.cpp``. Arrays are float32, C-contiguous."""

from collections.abc import Sequence
from typing import Any

Array = Any  # anything with a buffer or DLPack: numpy, torch
Arrays = tuple[Array, ...]  # means, log_scales, quaternions, opacity_logits, sh_dc, sh_rest
Statistics = tuple[Array, ...]  # means2d, means2d_abs, weight, weighted_map

# camera centre; near plane, far plane, low pass, largest alpha, radius clip; plain colours
Conventions = tuple[Sequence[float], Sequence[float], bool]

TILE: int

def instruction_set() -> str: ...
def use_instruction_set(name: str) -> bool: ...
def multiply_add(rounds: int) -> float: ...

class Rendering:
    def __init__(
        self,
        rotation: Sequence[float],
        translation: Sequence[float],
        intrinsics: Sequence[float],
        width: int,
        height: int,
        background: Sequence[float],
        sh_degree: int,
        threads: int,
        differentiable: bool,
        conventions: Conventions | None = None,
    ) -> None: ...
    def forward(
        self,
        splats: Arrays,
        image: Array,
        alpha: Array,
        radii: Array,
        means2d: Array,
        extents: Array | None = None,
        extra: Array | None = None,
    ) -> int: ...
    def backward(
        self,
        splats: Arrays,
        grad_image: Array,
        grad_alpha: Array | None,
        pixel_map: Array | None,
        grads: Arrays,
        seen: Statistics,
        statistics: bool,
        grad_extra: Array | None = None,
        grad_camera: Array | None = None,
    ) -> None: ...
    def descend(
        self,
        splats: Arrays,
        grad_image: Array,
        grad_alpha: Array | None,
        pixel_map: Array | None,
        first_moments: Arrays,
        second_moments: Arrays,
        rates: Sequence[float],
        settings: Sequence[float],
        step: int,
        seen: Statistics,
        statistics: bool,
    ) -> int: ...
    @property
    def pairs(self) -> int: ...
    @property
    def evaluated(self) -> int: ...
    @property
    def seconds(self) -> list[float]: ...
    @property
    def workspace_bytes(self) -> int: ...

def photometric_loss(
    image: Array,
    target: Array,
    weight: Array | None,
    weight_ssim: bool,
    ssim_lambda: float,
    threads: int,
    grad: Array,
) -> tuple[float, float, float, float]: ...
