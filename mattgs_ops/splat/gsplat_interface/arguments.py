"""What ``rasterization`` takes: shapes, types and values, checked before any work starts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch._C._functorch import is_functorch_wrapped_tensor  # it has no public name
from torch.autograd.forward_ad import unpack_dual

from mattgs_ops.errors import InputError
from mattgs_ops.splat.rasterize import MAX_PIXELS_A_SIDE, MAX_THREADS

RENDER_MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
MOST_SH_DEGREE = 3
# gsplat's arguments that this engine has nothing behind: the one value that is taken, and why
REFUSED: dict[str, tuple[object, str]] = {
    "sparse_grad": (False, "gradients are dense"),
    "rasterize_mode": ("classic", "there is no anti-aliasing by opacity"),
    "distributed": (False, "the engine runs on one machine"),
    "camera_model": ("pinhole", "cameras have no other projection; undistort the photos"),
    "covars": (None, "covariances come from quats and scales"),
    "with_ut": (False, "the projection is EWA splatting's"),
    "with_eval3d": (False, "splats are evaluated on the image"),
    "radial_coeffs": (None, "cameras have no distortion; undistort the photos"),
    "tangential_coeffs": (None, "cameras have no distortion; undistort the photos"),
    "thin_prism_coeffs": (None, "cameras have no distortion; undistort the photos"),
    "ftheta_coeffs": (None, "cameras have no distortion; undistort the photos"),
    "rolling_shutter": (None, "the shutter is global"),
    "viewmats_rs": (None, "the shutter is global"),
}


@dataclass(frozen=True)
class Limits:
    """Numbers by which a rendering is cut off, as gsplat names them."""

    near_plane: float
    far_plane: float
    eps2d: float
    radius_clip: float


@dataclass(frozen=True)
class Scene:
    """The tensors with all batch dimensions in one, checked; see :func:`checked`."""

    means: Tensor  # [B, N, 3]
    quats: Tensor  # [B, N, 4]
    scales: Tensor  # [B, N, 3]
    opacities: Tensor  # [B, N]
    colors: Tensor  # [B, N, D] or [B, C, N, D]; with harmonics [..., K, 3] in place of D
    viewmats: Tensor  # [B, C, 4, 4]
    Ks: Tensor  # [B, C, 3, 3]
    backgrounds: Tensor | None  # [B, C, D]
    batch: tuple[int, ...]
    width: int
    height: int
    sh_degree: int | None

    @property
    def cameras(self) -> int:
        """Return the number of cameras of one scene of the batch."""
        return int(self.viewmats.shape[1])

    @property
    def count(self) -> int:
        """Return the number of splats of one scene of the batch."""
        return int(self.means.shape[1])

    @property
    def per_camera(self) -> bool:
        """Whether each camera has colours of its own."""
        return self.colors.dim() == (4 if self.sh_degree is None else 5)


def checked(
    named: Mapping[str, Tensor],
    backgrounds: Tensor | None,
    width: int,
    height: int,
    sh_degree: int | None,
) -> Scene:
    """Check the tensors of ``rasterization`` by name and flatten their batch dimensions.

    ``named`` has means, quats, scales, opacities, colors, viewmats and Ks. Raises
    :class:`InputError` that names the argument, what was expected and what was found.
    """
    for name, tensor in named.items():
        _check_type(name, tensor)
    for name, size in (("width", width), ("height", height)):
        if not _is_int(size):
            raise InputError(f"{name}: expected an int, found {_told(size)}")
        if not 1 <= size <= MAX_PIXELS_A_SIDE:
            raise InputError(f"{name}: expected 1 to {MAX_PIXELS_A_SIDE}, found {size}")
    means, viewmats, colors = named["means"], named["viewmats"], named["colors"]
    if means.dim() < 2:
        raise InputError(f"means: expected shape [..., N, 3], found {tuple(means.shape)}")
    if viewmats.dim() < 3:
        raise InputError(f"viewmats: expected shape [..., C, 4, 4], found {tuple(viewmats.shape)}")
    batch, count, cameras = tuple(means.shape[:-2]), means.shape[-2], viewmats.shape[-3]
    _check_shape("means", means, (*batch, count, 3))
    _check_shape("quats", named["quats"], (*batch, count, 4))
    _check_shape("scales", named["scales"], (*batch, count, 3))
    _check_shape("opacities", named["opacities"], (*batch, count))
    _check_shape("viewmats", viewmats, (*batch, cameras, 4, 4))
    _check_shape("Ks", named["Ks"], (*batch, cameras, 3, 3))
    _check_colors(colors, batch, cameras, count, sh_degree)
    if backgrounds is not None:
        _check_type("backgrounds", backgrounds)
        _check_shape("backgrounds", backgrounds, (*batch, cameras, colors.shape[-1]))
    _check_cameras(viewmats, named["Ks"])
    _check_opacities(named["opacities"])
    many = math.prod(batch)

    def flat(tensor: Tensor) -> Tensor:
        return tensor.reshape(many, *tensor.shape[len(batch) :])

    return Scene(
        **{name: flat(tensor) for name, tensor in named.items()},
        backgrounds=None if backgrounds is None else flat(backgrounds),
        batch=batch,
        width=width,
        height=height,
        sh_degree=sh_degree,
    )


def check_settings(
    limits: Limits, render_mode: str, threads: int, refused: Mapping[str, Any]
) -> None:
    """Raise :class:`InputError` for a setting that is out of range or not to be had here."""
    for name, value in refused.items():
        taken, reason = REFUSED[name]
        # gsplat's own enumeration has a name for the global shutter; arrays compare by element
        same = not isinstance(value, Tensor | np.ndarray) and value == taken
        if value is taken or same or getattr(value, "name", None) == "GLOBAL":
            continue
        raise InputError(f"{name}: expected {taken!r} ({reason}), found {_told(value)}")
    if render_mode not in RENDER_MODES:
        raise InputError(
            f"render_mode: expected one of {', '.join(RENDER_MODES)}, found {render_mode!r}"
        )
    if not _is_int(threads) or not 1 <= threads <= MAX_THREADS:
        raise InputError(
            f"threads: expected a whole number, 1 to {MAX_THREADS}, found {_told(threads)}"
        )
    for name, value in vars(limits).items():
        scalar = isinstance(value, Tensor) and value.dim() == 0
        if isinstance(value, bool) or not (isinstance(value, Real) or scalar):
            raise InputError(f"{name}: expected a number, found {_told(value)}")
    if not 0 < limits.near_plane < limits.far_plane:
        raise InputError(
            f"near_plane: expected a number between 0 and far_plane ({limits.far_plane}), "
            f"found {limits.near_plane}"
        )
    for name in ("eps2d", "radius_clip"):
        value = getattr(limits, name)
        if not (math.isfinite(value) and value >= 0):
            raise InputError(f"{name}: expected a number of pixels from 0 on, found {value}")


def _told(value: object) -> str:
    return (
        f"a tensor {list(value.shape)}" if isinstance(value, Tensor | np.ndarray) else repr(value)
    )


def _is_int(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _check_type(name: str, tensor: object) -> None:
    if not isinstance(tensor, Tensor):
        raise InputError(f"{name}: expected a tensor, found {type(tensor).__name__}")
    if tensor.layout != torch.strided:
        raise InputError(f"{name}: expected a dense tensor, found {tensor.layout}")
    if is_functorch_wrapped_tensor(tensor) or _is_dual(tensor):
        raise InputError(
            f"{name}: expected a plain tensor (gradients come from backward() alone), found one of "
            "torch.func's or of forward-mode differentiation"
        )
    if tensor.dtype != torch.float32 or tensor.device.type != "cpu":
        raise InputError(
            f"{name}: expected float32 on the CPU, found {tensor.dtype} on {tensor.device}"
        )


def _is_dual(tensor: Tensor) -> bool:
    """Whether a tensor carries a tangent, as in torch's forward-mode differentiation."""
    parts = unpack_dual(tensor)  # type: ignore[no-untyped-call]  # torch leaves it untyped
    return parts.tangent is not None


def _check_shape(name: str, tensor: Tensor, shape: tuple[int, ...]) -> None:
    if tuple(tensor.shape) != shape:
        raise InputError(f"{name}: expected shape {shape}, found {tuple(tensor.shape)}")


def _check_colors(
    colors: Tensor, batch: tuple[int, ...], cameras: int, count: int, sh_degree: int | None
) -> None:
    if sh_degree is not None and not (_is_int(sh_degree) and 0 <= sh_degree <= MOST_SH_DEGREE):
        raise InputError(
            f"sh_degree: expected None or 0 to {MOST_SH_DEGREE}, found {_told(sh_degree)}"
        )
    found = tuple(colors.shape)
    own = 1 if sh_degree is None else 2  # dimensions of one splat's colour
    heads = ((*batch, count), (*batch, cameras, count))
    tail = "D" if sh_degree is None else "K, 3"
    if len(found) <= own or found[:-own] not in heads or found[-1] < 1:
        wanted = " or ".join(f"({', '.join(map(str, head))}, {tail})" for head in heads)
        raise InputError(f"colors: expected shape {wanted}, found {found}")
    if sh_degree is None:
        return
    if found[-1] != 3 or found[-2] < (sh_degree + 1) ** 2:
        raise InputError(
            f"colors: expected [..., K, 3] with K of {(sh_degree + 1) ** 2} or more for "
            f"sh_degree {sh_degree}, found {found}"
        )


def _check_cameras(viewmats: Tensor, ks: Tensor) -> None:
    if ks.requires_grad:
        raise InputError("Ks: expected intrinsics without a gradient, found requires_grad")
    with torch.no_grad():
        if not bool(torch.isfinite(viewmats).all() and torch.isfinite(ks).all()):
            raise InputError("viewmats, Ks: expected finite numbers, found NaN or infinity")
        focal = torch.stack([ks[..., 0, 0], ks[..., 1, 1]])
        if not bool((focal > 0).all()):
            raise InputError(f"Ks: expected positive focal lengths, found {float(focal.min())}")
        if bool((ks[..., 0, 1] != 0).any()):
            raise InputError("Ks: expected no skew in [0, 1], found some")
        last = viewmats.new_tensor([0.0, 0.0, 0.0, 1.0])
        if not torch.equal(viewmats[..., 3, :], last.expand_as(viewmats[..., 3, :])):
            raise InputError("viewmats: expected (0, 0, 0, 1) as the last row, found another")
        if bool((torch.linalg.det(viewmats[..., :3, :3].double()).abs() < 1e-12).any()):
            raise InputError("viewmats: expected rotations in [:3, :3], found a singular matrix")


def _check_opacities(opacities: Tensor) -> None:
    if not opacities.numel():
        return
    low, high = (float(v) for v in torch.aminmax(opacities.detach()))
    if low < 0 or high > 1:
        raise InputError(f"opacities: expected 0 to 1, found {low if low < 0 else high}")
