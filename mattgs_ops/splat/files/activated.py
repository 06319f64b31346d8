"""Splats as formats store them: activated, normalised, in float64 NumPy arrays; and back."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_CONSTANT, SH_REST

HALF_STEP = 0.5 / 255  # of an opacity that a byte holds

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Activated:
    """N splats; ``colour`` is the constant term, 0.5 + Y₀₀ · dc, not clamped."""

    means: Floats  # [N, 3]
    log_scales: Floats  # [N, 3]
    quaternions: Floats  # [N, 4] wxyz, of unit length, w ≥ 0
    alpha: Floats  # [N] in (0, 1)
    colour: Floats  # [N, 3]
    sh_dc: Floats  # [N, 3]
    sh_rest: Floats  # [N, 15, 3]

    def take(self, order: NDArray[np.int64]) -> "Activated":
        """Return the splats at these places."""
        return Activated(**{name: values[order] for name, values in vars(self).items()})


def activated(splats: Splats) -> Activated:
    """Return what the parameters stand for; a quaternion of length zero means no rotation."""
    raw = {name: tensor.detach().numpy().astype(np.float64) for name, tensor in splats.items()}
    quaternions = raw["quaternions"]
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(length > 0, quaternions / np.maximum(length, 1e-30), [1.0, 0.0, 0.0, 0.0])
    return Activated(
        means=raw["means"],
        log_scales=raw["log_scales"],
        quaternions=unit * np.where(unit[:, :1] < 0, -1.0, 1.0),
        alpha=1 / (1 + np.exp(-np.clip(raw["opacity_logits"], -60, 60))),
        colour=0.5 + SH_CONSTANT * raw["sh_dc"],
        sh_dc=raw["sh_dc"],
        sh_rest=raw["sh_rest"],
    )


def splats_of(
    path: Path,
    *,
    means: Floats,
    log_scales: Floats,
    quaternions: Floats,
    alpha: Floats,
    sh_dc: Floats,
    sh_rest: Floats | None = None,
) -> Splats:
    """Return splats of a file's numbers, opacity in [0, 1]; shapes as in :class:`Activated`.

    Opacities of 0 and 1 are kept off infinity by half a step of 8 bits. Raises
    :class:`InputError` naming the file for NaN and infinity.
    """
    bound = np.clip(alpha, HALF_STEP, 1 - HALF_STEP)
    rest = np.zeros((len(means), SH_REST, 3)) if sh_rest is None else sh_rest
    fields = {
        "means": means,
        "log_scales": log_scales,
        "quaternions": quaternions,
        "opacity_logits": np.log(bound / (1 - bound)),
        "sh_dc": sh_dc,
        "sh_rest": rest,
    }
    for name, values in fields.items():
        if not np.isfinite(values).all():
            raise InputError(f"{path}: expected finite numbers, found NaN or infinity in `{name}`")
    return Splats(
        **{
            name: torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
            for name, values in fields.items()
        }
    )


def levels(values: Floats, top: int) -> Floats:
    """Round to whole levels 0 … ``top``; what lies outside goes to the nearest end."""
    out: Floats = np.clip(np.floor(values + 0.5), 0, top)
    return out
