"""Small scenes, and what the slow reference makes of them with gsplat's conventions."""

from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from tests.reference import splatting

WIDTH, HEIGHT = 40, 30
GSPLAT = {"alpha_max": 0.999, "near": 0.01}  # gsplat 1.5.3
DIFFERENTIABLE = ("means", "quats", "scales", "opacities", "colors", "viewmats", "backgrounds")

Tensors = dict[str, Tensor]


def scene(seed: int, *, degree: int | None = None, channels: int = 3, count: int = 30) -> Tensors:
    """Return splats before two cameras, one of them turned."""
    g = torch.Generator().manual_seed(seed)
    viewmats = torch.eye(4).repeat(2, 1, 1)
    cosine, sine = torch.cos(torch.tensor(0.25)), torch.sin(torch.tensor(0.25))
    viewmats[1, 0, 0] = viewmats[1, 2, 2] = cosine
    viewmats[1, 0, 2], viewmats[1, 2, 0] = sine, -sine
    viewmats[1, :3, 3] = torch.tensor([-0.8, 0.2, 0.5])
    shape = (count, channels) if degree is None else (count, (degree + 1) ** 2, 3)
    # the last splat lies behind both cameras
    means = torch.randn(count, 3, generator=g) + torch.tensor([0.0, 0.0, 4.0])
    means[-1, 2] = -3.0
    return {
        "means": means,
        "quats": torch.randn(count, 4, generator=g),
        "scales": 0.05 + 0.4 * torch.rand(count, 3, generator=g),
        "opacities": 0.05 + 0.94 * torch.rand(count, generator=g),
        "colors": torch.rand(shape, generator=g) - (0.0 if degree is None else 0.4),
        "viewmats": viewmats,
        "Ks": torch.tensor([[40.0, 0, 19], [0, 44, 16], [0, 0, 1]]).repeat(2, 1, 1),
        "backgrounds": torch.rand(2, channels if degree is None else 3, generator=g),
    }


def reference(
    given: Tensors, mode: str, degree: int | None, camera: int, **limits: float
) -> tuple[Tensor, Tensor, splatting.Reference]:
    """Return image [H, W, X] and alpha [H, W, 1] of one camera, in float64."""
    view, k = given["viewmats"][camera], given["Ks"][camera]
    place: Any = SimpleNamespace(
        rotation=view[:3, :3],
        translation=view[:3, 3],
        centre=torch.linalg.inv(view)[:3, 3],
        intrinsics=SimpleNamespace(
            width=WIDTH,
            height=HEIGHT,
            fx=float(k[0, 0]),
            fy=float(k[1, 1]),
            cx=float(k[0, 2]),
            cy=float(k[1, 2]),
        ),
    )
    colors = given["colors"] if given["colors"].dim() < 3 + (degree is not None) else None
    colors = given["colors"][camera] if colors is None else colors
    sh = colors if degree is not None else (colors.new_zeros(len(colors), 1, 3))
    splats = {
        "means": given["means"],
        "quaternions": given["quats"],
        "log_scales": given["scales"].log(),
        # neither 0 nor 1, whose logit is infinite
        "opacity_logits": torch.logit(given["opacities"] * (1 - 2e-12) + 1e-12),
        "sh_dc": sh[:, 0],
        "sh_rest": sh[:, 1:],
    }
    drawn = splatting.render(
        splats, place, (0, 0, 0), degree or 0, splatting.Limits(**{**GSPLAT, **limits})
    )
    shown = drawn.image
    if degree is None:
        shown = torch.einsum("nhw,nd->hwd", drawn.weights, colors)
    alpha = drawn.alpha[..., None]
    shown = shown + given["backgrounds"][camera] * (1 - alpha)
    depth = given["means"] @ view[2, :3] + view[2, 3]
    z = torch.einsum("nhw,n->hw", drawn.weights, depth)[..., None]
    if mode.endswith("ED"):
        z = z / alpha.clamp(min=1e-10)
    if mode in ("D", "ED"):
        return z, alpha, drawn
    return (shown if mode == "RGB" else torch.cat([shown, z], dim=-1)), alpha, drawn
