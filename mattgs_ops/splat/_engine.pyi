"""Types of the compiled engine; see ``_kernels/module.cpp``. Arrays are float32, C-contiguous."""

from collections.abc import Sequence
from typing import Any

Array = Any  # anything with a buffer or DLPack: numpy, torch
Arrays = tuple[Array, ...]  # means, log_scales, quaternions, opacity_logits, sh_dc, sh_rest

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
    ) -> None: ...
    def forward(
        self, splats: Arrays, image: Array, alpha: Array, radii: Array, means2d: Array
    ) -> int: ...
    def backward(
        self,
        splats: Arrays,
        grad_image: Array,
        grad_alpha: Array | None,
        pixel_map: Array | None,
        grads: Arrays,
        means2d: Array,
        means2d_abs: Array,
        weight: Array,
        weighted_map: Array,
        statistics: bool,
    ) -> None: ...
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
def adam(
    values: Array,
    grads: Array,
    first_moments: Array,
    second_moments: Array,
    rate: float,
    beta1: float,
    beta2: float,
    epsilon: float,
    step: int,
    threads: int,
) -> None: ...
