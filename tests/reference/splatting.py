"""Slow, obvious float64 splatting with autograd: what the compiled engine is checked against.

Every splat is composited over every pixel of the image, front to back, in plain torch operations.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from mattgs_ops.capture.camera import Camera

ALPHA_MIN, T_MIN, FOV_MARGIN = 1 / 255, 1e-4, 0.3


@dataclass(frozen=True)
class Limits:
    """Where renderers differ; the defaults are those of 3DGS."""

    low_pass: float = 0.3
    alpha_max: float = 0.99
    near: float = 0.2
    far: float = float("inf")


THREE_DGS = Limits()


@dataclass
class Reference:
    image: Tensor  # [H, W, 3]
    alpha: Tensor  # [H, W]
    weights: Tensor  # [N, H, W] blending weights
    visible: Tensor  # [N] drawn on at least one pixel
    shift: Tensor  # [N, H, W, 2] zeros added to each splat's centre at each pixel


def rotation(q: Tensor) -> Tensor:  # [N, 4] -> [N, 3, 3]
    w, x, y, z = torch.nn.functional.normalize(q, dim=1).unbind(1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def sh_functions(d: Tensor, degree: int) -> Tensor:  # [N, 3] -> [N, (degree + 1)^2]
    """Real spherical harmonics with the Condon-Shortley phase, as 3DGS orders and signs them."""
    x, y, z = d.unbind(1)
    pi = torch.pi
    out = [torch.full_like(x, 0.5 * (1 / pi) ** 0.5)]
    if degree >= 1:
        c = (3 / (4 * pi)) ** 0.5
        out += [-c * y, c * z, -c * x]
    if degree >= 2:
        c = 0.5 * (15 / pi) ** 0.5
        out += [c * x * y, -c * y * z, 0.25 * (5 / pi) ** 0.5 * (2 * z * z - x * x - y * y)]
        out += [-c * x * z, 0.5 * c * (x * x - y * y)]
    if degree >= 3:
        a, b = 0.25 * (35 / (2 * pi)) ** 0.5, 0.5 * (105 / pi) ** 0.5
        c, e = 0.25 * (21 / (2 * pi)) ** 0.5, 0.25 * (7 / pi) ** 0.5
        out += [-a * y * (3 * x * x - y * y), b * x * y * z]
        out += [-c * y * (4 * z * z - x * x - y * y)]
        out += [e * z * (2 * z * z - 3 * x * x - 3 * y * y)]
        out += [-c * x * (4 * z * z - x * x - y * y), 0.5 * b * z * (x * x - y * y)]
        out += [-a * x * (x * x - 3 * y * y)]
    return torch.stack(out, 1)


def project(
    splats: dict[str, Tensor], camera: Camera, limits: Limits = THREE_DGS
) -> tuple[Tensor, Tensor, Tensor]:
    """Return centres [N, 2], 2D covariances [N, 2, 2] and depths [N].

    The camera's pose may be tensors that require gradients.
    """
    i = camera.intrinsics
    world = torch.as_tensor(camera.rotation)
    local = splats["means"] @ world.T + torch.as_tensor(camera.translation)
    depth = local[:, 2]
    z = torch.where(depth > limits.near, depth, torch.ones_like(depth))
    ratio = local[:, :2] / z[:, None]
    size = torch.tensor([i.width, i.height], dtype=torch.float64)
    focal = torch.tensor([i.fx, i.fy], dtype=torch.float64)
    middle = torch.tensor([i.cx, i.cy], dtype=torch.float64)
    margin = FOV_MARGIN * size / (2 * focal)
    low, high = -middle / focal - margin, (size - middle) / focal + margin
    clamped = torch.minimum(torch.maximum(ratio, low), high)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([i.fx / z, zero, -i.fx * clamped[:, 0] / z], -1),
            torch.stack([zero, i.fy / z, -i.fy * clamped[:, 1] / z], -1),
        ],
        -2,
    )
    m = jacobian @ world @ rotation(splats["quaternions"]) * splats["log_scales"].exp()[:, None, :]
    covariance = m @ m.transpose(1, 2) + limits.low_pass * torch.eye(2, dtype=torch.float64)
    return ratio * focal + middle, covariance, depth


def render(
    splats: dict[str, Tensor],
    camera: Camera,
    background: tuple[float, float, float],
    sh_degree: int = 3,
    limits: Limits = THREE_DGS,
) -> Reference:
    """Render float64 parameters named as the fields of Splats."""
    i = camera.intrinsics
    centres, covariance, depth = project(splats, camera, limits)
    opacity = splats["opacity_logits"].sigmoid()
    direction = splats["means"] - torch.as_tensor(camera.centre)
    basis = sh_functions(torch.nn.functional.normalize(direction, dim=1), sh_degree)
    sh = torch.cat([splats["sh_dc"][:, None], splats["sh_rest"]], 1)[:, : basis.shape[1]]
    colour = torch.clamp_min((basis[:, :, None] * sh).sum(1) + 0.5, 0)

    y, x = torch.meshgrid(
        torch.arange(i.height, dtype=torch.float64) + 0.5,
        torch.arange(i.width, dtype=torch.float64) + 0.5,
        indexing="ij",
    )
    pixels = torch.stack([x, y], -1)  # [H, W, 2]
    count = len(depth)
    shift = torch.zeros(count, i.height, i.width, 2, dtype=torch.float64, requires_grad=True)
    transmittance = torch.ones(i.height, i.width, dtype=torch.float64)
    running = torch.ones(i.height, i.width, dtype=torch.bool)
    image = torch.zeros(i.height, i.width, 3, dtype=torch.float64)
    weights = [torch.zeros_like(transmittance)] * count
    for n in torch.argsort(depth, stable=True).tolist():
        if not limits.near < depth[n] < limits.far:
            continue
        d = pixels - (centres[n] + shift[n])
        inverse = torch.linalg.inv(covariance[n])
        power = -0.5 * torch.einsum("hwi,ij,hwj->hw", d, inverse, d)
        alpha = torch.clamp_max(opacity[n] * power.exp(), limits.alpha_max)
        alpha = torch.where(alpha >= ALPHA_MIN, alpha, torch.zeros_like(alpha))
        after = transmittance * (1 - alpha)
        running = running & (after >= T_MIN)
        weights[n] = torch.where(running, alpha * transmittance, torch.zeros_like(alpha))
        transmittance = torch.where(running, after, transmittance)
        image = image + weights[n][:, :, None] * colour[n]
    image = image + transmittance[:, :, None] * torch.tensor(background, dtype=torch.float64)
    stacked = torch.stack(weights) if count else torch.zeros(0, i.height, i.width)
    visible = (stacked > 0).flatten(1).any(1) if count else torch.zeros(0, dtype=torch.bool)
    return Reference(image, 1 - transmittance, stacked, visible, shift)


def ssim_map(image: Tensor, target: Tensor) -> Tensor:
    """SSIM of [H, W, 3] images per value: 11×11 Gaussian of sigma 1.5, zeros outside."""
    i = torch.arange(11, dtype=torch.float64) - 5
    g = torch.exp(-(i**2) / (2 * 1.5**2))
    g = g / g.sum()
    window = (g[:, None] * g[None, :]).expand(3, 1, 11, 11)

    def blur(values: Tensor) -> Tensor:
        planes = values.permute(2, 0, 1)[None]
        return torch.nn.functional.conv2d(planes, window, padding=5, groups=3)[0].permute(1, 2, 0)

    mx, my = blur(image), blur(target)
    xx, yy, xy = blur(image**2) - mx**2, blur(target**2) - my**2, blur(image * target) - mx * my
    c1, c2 = 0.01**2, 0.03**2
    return (2 * mx * my + c1) * (2 * xy + c2) / ((mx**2 + my**2 + c1) * (xx + yy + c2))
