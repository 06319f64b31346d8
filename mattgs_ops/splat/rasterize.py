"""Rendering of splats and its gradients, by the compiled engine.

Conventions of the original 3DGS (Kerbl et al. 2023): 0.3 px² added to the projected covariance,
alpha clamped to 0.99 and skipped below 1/255, a pixel is finished before its transmittance would
fall below 1e-4, near plane at 0.2, the Jacobian's x/z and y/z clamped at 1.3 times the field of
view, colour ``max(SH + 0.5, 0)``. Ellipses are bounded exactly by alpha = 1/255, not by 3 sigma.
Gradients are the true derivatives, also where a value was clamped. Results have the same bits from
run to run and for any number of threads.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from mattgs_ops.capture.camera import Camera
from mattgs_ops.errors import InputError
from mattgs_ops.splat import _engine
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.memory import Memory, Unshared

MAX_PIXELS_A_SIDE = 32_768  # of an image; more is a mistake in the caller's units
MAX_THREADS = 1024
# of a rendering and the way back; the last one of `Adam.descend` moves the splats, too
PASSES = ("project", "sort", "bin", "forward", "backward", "project back")


@dataclass
class Rendering:
    """A rendered view and what :func:`backward` needs to know about it."""

    image: Tensor  # [H, W, 3] composited over the background, not clamped
    alpha: Tensor  # [H, W] one minus the final transmittance
    radii: Tensor  # [N] 3 sigma of the longer axis, px; 0 = not visible
    means2d: Tensor  # [N, 2] projected centres, px; 0 where behind the near plane
    splats: Splats
    engine: Any  # the compiled engine's own

    @property
    def evaluated_pairs(self) -> int:
        """Splat-pixel pairs that compositing looked at (computed on request)."""
        return int(self.engine.evaluated)

    @property
    def tile_pairs(self) -> int:
        """Splat-tile pairs that were sorted."""
        return int(self.engine.pairs)

    @property
    def pass_seconds(self) -> dict[str, float]:
        """Seconds of each pass: processor time with one thread, else wall-clock time."""
        return dict(zip(PASSES, self.engine.seconds, strict=True))

    @property
    def workspace_bytes(self) -> int:
        """Memory that the engine holds for this rendering, kept for the next one."""
        return int(self.engine.workspace_bytes)


@dataclass
class SplatStatistics:
    """What a pass back over the pixels saw of each splat."""

    means2d: Tensor  # [N, 2] dL/d projected centre, px
    means2d_abs: Tensor  # [N, 2] the same with absolute values summed over pixels
    weight: Tensor  # [N] sum of blending weights
    weighted_map: Tensor  # [N] sum of blending weight times pixel_map

    @classmethod
    def taken(cls, memory: Memory, count: int, *, statistics: bool) -> "SplatStatistics":
        """Return uninitialised ones; without ``statistics`` all but ``means2d`` are empty."""
        kept = count if statistics else 0
        return cls(
            memory.take("d means2d", count, 2),
            memory.take("d means2d_abs", kept, 2),
            memory.take("weight", kept),
            memory.take("weighted_map", kept),
        )

    def arrays(self) -> tuple[Any, ...]:
        """Return them as NumPy arrays on the same memory."""
        return tuple(t.numpy() for t in vars(self).values())


@dataclass
class Gradients:
    """dL/d each parameter of the splats, and statistics of the same pass."""

    means: Tensor  # [N, 3]
    log_scales: Tensor  # [N, 3]
    quaternions: Tensor  # [N, 4]
    opacity_logits: Tensor  # [N]
    sh_dc: Tensor  # [N, 3]
    sh_rest: Tensor  # [N, 15, 3]
    observed: SplatStatistics

    def tensors(self) -> dict[str, Tensor]:
        """Return all of them by name."""
        parameters = {name: value for name, value in vars(self).items() if name != "observed"}
        return parameters | vars(self.observed)


def render(
    splats: Splats,
    camera: Camera,
    background: tuple[float, float, float],
    *,
    sh_degree: int = 3,
    threads: int = 1,
    memory: Memory | None = None,
    differentiable: bool = True,
) -> Rendering:
    """Render ``splats`` as ``camera`` sees them over a plain ``background``.

    ``sh_degree`` 0 to 3: spherical harmonics above it are not used. With a ``memory`` the result
    lies there and is overwritten by the next rendering that is given the same one. What is not
    ``differentiable`` takes a little less time, and has no way back. Raises
    :class:`InputError` for wrong shapes, for a camera without an image, and for a splat with a NaN
    or infinite parameter (its field and row are named).
    """
    splats.check()
    _check_camera(camera)
    if not 0 <= sh_degree <= 3:
        raise InputError(f"sh_degree: expected 0 to 3, found {sh_degree}")
    if not 1 <= threads <= MAX_THREADS:
        raise InputError(f"threads: expected 1 to {MAX_THREADS}, found {threads}")
    if len(background) != 3 or not all(map(math.isfinite, background)):
        raise InputError(f"background: expected three finite numbers, found {background}")
    i = camera.intrinsics
    engine = _engine.Rendering(
        camera.rotation.ravel().tolist(),
        camera.translation.tolist(),
        (i.fx, i.fy, i.cx, i.cy),
        i.width,
        i.height,
        tuple(map(float, background)),
        sh_degree,
        threads,
        differentiable,
    )
    memory = Unshared() if memory is None else memory
    image = memory.take("image", i.height, i.width, 3)
    alpha = memory.take("alpha", i.height, i.width)
    radii, means2d = memory.take("radii", len(splats)), memory.take("means2d", len(splats), 2)
    bad = engine.forward(
        splat_arrays(splats), image.numpy(), alpha.numpy(), radii.numpy(), means2d.numpy()
    )
    if bad:
        raise InputError(_describe_not_finite(splats))
    return Rendering(image, alpha, radii, means2d, splats, engine)


def backward(
    rendering: Rendering,
    grad_image: Tensor,
    grad_alpha: Tensor | None = None,
    *,
    pixel_map: Tensor | None = None,
    statistics: bool = True,
    memory: Memory | None = None,
) -> Gradients:
    """Return the gradients of a loss given its gradient with respect to the rendered image.

    ``grad_image`` [H, W, 3], ``grad_alpha`` [H, W] or none, ``pixel_map`` [H, W] (attention, say)
    or none, all float32. The splats must be those that were rendered, unchanged. Without
    ``statistics``, a little faster, ``means2d_abs``, ``weight`` and ``weighted_map`` are empty.
    With a ``memory`` the gradients lie there, until the next call with the same one. Raises
    :class:`InputError` for wrong shapes or types.
    """
    splats = rendering.splats
    arrays = checked_pixels(rendering, grad_image, grad_alpha, pixel_map)
    memory = Unshared() if memory is None else memory
    grads = Splats(**{name: memory.take(f"d {name}", *t.shape) for name, t in splats.items()})
    observed = SplatStatistics.taken(memory, len(splats), statistics=statistics)
    rendering.engine.backward(
        splat_arrays(splats), *arrays, splat_arrays(grads), observed.arrays(), statistics
    )
    return Gradients(**dict(grads.items()), observed=observed)


def checked_pixels(
    rendering: Rendering,
    grad_image: Tensor,
    grad_alpha: Tensor | None,
    pixel_map: Tensor | None,
) -> list[Any]:
    """Return what goes back from the pixels as arrays; see :func:`backward` for what it raises."""
    splats = rendering.splats
    splats.check()
    if len(splats) != len(rendering.radii):
        raise InputError(
            f"splats: expected the {len(rendering.radii)} that were rendered, found {len(splats)}"
        )
    height, width = rendering.alpha.shape
    given = {
        "grad_image": (grad_image, (height, width, 3)),
        "grad_alpha": (grad_alpha, (height, width)),
        "pixel_map": (pixel_map, (height, width)),
    }
    return [checked_array(name, t, shape) for name, (t, shape) in given.items()]


def checked_array(name: str, tensor: Tensor | None, shape: tuple[int, ...]) -> Any:
    """Return a tensor as a NumPy array on the same memory (None stays None).

    Raises :class:`InputError` unless it is float32 on the CPU and of that shape.
    """
    if tensor is None:
        return None
    if tuple(tensor.shape) != shape:
        raise InputError(f"{name}: expected shape {shape}, found {tuple(tensor.shape)}")
    if tensor.dtype != torch.float32 or tensor.device.type != "cpu":
        raise InputError(
            f"{name}: expected float32 on the CPU, found {tensor.dtype} on {tensor.device}"
        )
    return tensor.detach().contiguous().numpy()


def splat_arrays(splats: Splats) -> tuple[Any, ...]:
    """Return the parameters as NumPy arrays on the same memory, in the engine's order."""
    return tuple(tensor.detach().numpy() for _, tensor in splats.items())


def _check_camera(camera: Camera) -> None:
    i = camera.intrinsics
    for name, size in (("width", i.width), ("height", i.height)):
        if not 1 <= size <= MAX_PIXELS_A_SIDE:
            raise InputError(f"camera.{name}: expected 1 to {MAX_PIXELS_A_SIDE}, found {size}")
    for name, focal in (("fx", i.fx), ("fy", i.fy)):
        if not (math.isfinite(focal) and focal > 0):
            raise InputError(f"camera.{name}: expected a positive focal length, found {focal}")
    pose = (*camera.rotation.ravel().tolist(), *camera.translation.ravel().tolist(), i.cx, i.cy)
    if len(pose) != 14 or not all(map(math.isfinite, pose)):
        raise InputError("camera: expected a finite pose [3, 3] and [3], and a finite centre")


def _describe_not_finite(splats: Splats) -> str:
    for name, tensor in splats.items():
        rows = torch.nonzero(~torch.isfinite(tensor).reshape(len(splats), -1).all(dim=1))
        if len(rows):
            return (
                f"splats.{name}: expected finite numbers, found NaN or infinity in "
                f"{len(rows)} of {len(splats)} rows, the first of them row {int(rows[0, 0])}"
            )
    return "splats: their colours overflow float32"
