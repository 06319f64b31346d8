"""Small scenes for tests of the engine: random ones, and the awkward cases one by one."""

import math
from collections.abc import Callable

import numpy as np
import torch

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.splat.gaussians import Splats


def camera(width: int = 45, height: int = 38, seed: int = 3, distance: float = 4.0) -> Camera:
    """Look at the origin from ``distance``, turned a little, with an off-centre principal point."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(np.eye(3) + 0.3 * rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(q))
    if np.linalg.det(q) < 0:
        q[:, 2] *= -1
    focal = 1.2 * max(width, height)
    i = Intrinsics(width, height, focal, 1.05 * focal, 0.52 * width, 0.47 * height)
    return Camera(i, q, np.array([0.05, -0.1, distance]))


def random_splats(count: int = 40, seed: int = 0, spread: float = 1.2) -> Splats:
    """Splats of all sizes and shapes around the origin, with view-dependent colour."""
    g = torch.Generator().manual_seed(seed)
    return Splats(
        means=(torch.rand(count, 3, generator=g) - 0.5) * 2 * spread,
        log_scales=math.log(0.15) + 0.7 * torch.randn(count, 3, generator=g),
        quaternions=torch.randn(count, 4, generator=g),
        opacity_logits=1.5 * torch.randn(count, generator=g),
        sh_dc=torch.randn(count, 3, generator=g),
        sh_rest=0.3 * torch.randn(count, 15, 3, generator=g),
    )


def _behind(splats: Splats, distance: float, every: int) -> None:
    # the rows of a rotation are the camera's axes: its third looks forward
    forward = torch.as_tensor(camera().rotation[2], dtype=torch.float32)
    splats.means[::every] -= distance * forward


def _huge(splats: Splats) -> None:
    splats.log_scales[::3] = math.log(50.0)
    splats.log_scales[1] = 20.0


def _needles(splats: Splats) -> None:
    splats.log_scales[:, 0] = math.log(2.0)
    splats.log_scales[:, 1:] = math.log(1e-4)


def _opaque_and_clear(splats: Splats) -> None:
    splats.opacity_logits[::2] = 40.0
    splats.opacity_logits[1::4] = -120.0


def _to_the_side(splats: Splats) -> None:
    splats.means[:, 0] += 3.0


CHANGES: dict[str, Callable[[Splats], object]] = {
    "behind the camera": lambda s: _behind(s, 10.0, 2),
    "all behind the camera": lambda s: _behind(s, 20.0, 1),
    "huge": _huge,
    "needle-thin": _needles,
    "tiny": lambda s: s.log_scales.fill_(-15.0),
    "opacity 0 and 1": _opaque_and_clear,
    "quaternions of all lengths": lambda s: s.quaternions.mul_(torch.logspace(-6, 6, 24)[:, None]),
    "off to the side": _to_the_side,
}
VIEWS = {
    "one pixel": camera().scaled(1, 1),
    "one row": camera().scaled(70, 1),
    "one column": camera().scaled(1, 70),
    "whole tiles": camera(64, 32),
    "one pixel more than a tile": camera(33, 33),
    "inside the scene": camera(distance=0.3),
}
COUNTS = {"no splats": 0, "one splat": 1}
AWKWARD = (*CHANGES, *VIEWS, *COUNTS, "many layers")


def awkward(name: str) -> tuple[Splats, Camera]:
    """Return one of :data:`AWKWARD`."""
    if name == "many layers":
        splats = random_splats(150, seed=6, spread=0.4)
        splats.opacity_logits[:] = 2.0
        return splats, camera()
    splats = random_splats(COUNTS.get(name, 24), seed=5)
    if name in CHANGES:
        CHANGES[name](splats)
    return splats, VIEWS.get(name, camera())
