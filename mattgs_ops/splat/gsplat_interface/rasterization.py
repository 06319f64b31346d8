"""Splats to images, differentiable in torch, with gsplat's arguments and results, on a CPU.

``rasterization`` follows gsplat 1.5.3 (Ye et al. 2024) in names, shapes, conventions and numbers;
docs/engine.md has a table of what is taken and what is refused.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Any, ParamSpec, TypeVar, cast

import torch
from torch import Tensor

from mattgs_ops.errors import InputError
from mattgs_ops.splat.gsplat_interface.arguments import Limits, Scene, check_settings, checked
from mattgs_ops.splat.gsplat_interface.composite import Composite
from mattgs_ops.splat.gsplat_interface.drawing import COLOURS, Drawing, Inputs

LEAST_ALPHA = 1e-10  # that an expected depth is divided by, as in gsplat
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def _not_compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Have ``torch.compile`` call a function as it is, which cannot see into the engine.

    What says so to torch imports its compiler, for seconds: only what is compiled waits for it.
    """

    @wraps(function)
    def called(*arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        if torch.compiler.is_compiling():
            as_it_is = torch.compiler.disable(function)  # type: ignore[no-untyped-call]
            return cast("Result", as_it_is(*arguments, **named))
        return function(*arguments, **named)

    return called


@_not_compiled
def rasterization(
    means: Tensor,  # [..., N, 3]
    quats: Tensor,  # [..., N, 4]
    scales: Tensor,  # [..., N, 3]
    opacities: Tensor,  # [..., N]
    colors: Tensor,  # [..., (C,) N, D] or [..., (C,) N, K, 3]
    viewmats: Tensor,  # [..., C, 4, 4]
    Ks: Tensor,  # [..., C, 3, 3]  # noqa: N803 - gsplat's name
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int = 16,  # noqa: ARG001 - the engine has tiles of its own
    backgrounds: Tensor | None = None,  # [..., C, D]
    render_mode: str = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    channel_chunk: int = 32,  # noqa: ARG001 - channels go in fours
    distributed: bool = False,
    camera_model: str = "pinhole",
    segmented: bool = False,  # noqa: ARG001 - how gsplat sorts
    covars: Tensor | None = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    radial_coeffs: Tensor | None = None,
    tangential_coeffs: Tensor | None = None,
    thin_prism_coeffs: Tensor | None = None,
    ftheta_coeffs: object = None,
    rolling_shutter: object = None,
    viewmats_rs: Tensor | None = None,
    *,
    threads: int | None = None,
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """Render N splats as C cameras see them; all tensors are float32 on the CPU.

    ``scales`` and ``opacities`` are themselves (not logarithms or logits), ``quats`` w x y z of any
    length. ``colors`` are D plain channels or, with an ``sh_degree`` of 0 to 3, harmonics whose
    colour is ``max(SH + 0.5, 0)``. ``viewmats`` are world to camera, axes x right, y down, z
    forward. ``render_mode`` D is the sum of weight times z, ED the same divided by the alpha.
    ``threads`` None means torch's own number; it never changes a result.

    Returns (render_colors [..., C, H, W, X], render_alphas [..., C, H, W, 1], meta): X is D for
    RGB, 1 for D and ED, D + 1 for the others, the depth last. Gradients go to means, quats, scales,
    opacities, colors, backgrounds and viewmats. ``meta`` has gsplat's entries but for those of its
    tiles: radii (int32), means2d, depths and opacities, each [..., C, N, ...], or when ``packed``
    [nnz, ...] with batch_ids, camera_ids and gaussian_ids; ``meta["means2d"]`` retains a gradient,
    and with ``absgrad`` has the attribute of that name after the way back.

    Raises :class:`InputError` naming the argument, what was expected and what was found.
    """
    limits = Limits(near_plane, far_plane, eps2d, radius_clip)
    threads = torch.get_num_threads() if threads is None else threads
    refused = {
        "sparse_grad": sparse_grad,
        "rasterize_mode": rasterize_mode,
        "distributed": distributed,
        "camera_model": camera_model,
        "covars": covars,
        "with_ut": with_ut,
        "with_eval3d": with_eval3d,
        "radial_coeffs": radial_coeffs,
        "tangential_coeffs": tangential_coeffs,
        "thin_prism_coeffs": thin_prism_coeffs,
        "ftheta_coeffs": ftheta_coeffs,
        "rolling_shutter": rolling_shutter,
        "viewmats_rs": viewmats_rs,
    }
    check_settings(limits, render_mode, threads, refused)
    named = {
        "means": means,
        "quats": quats,
        "scales": scales,
        "opacities": opacities,
        "colors": colors,
        "viewmats": viewmats,
        "Ks": Ks,
    }
    scene = checked(named, backgrounds, width, height, sh_degree)
    means2d, depths = _centres(scene, near_plane)
    scene, extra = _with_depth(scene, depths, render_mode)
    inputs = Inputs(
        scene.means,
        scene.quats,
        scene.scales,
        scene.opacities,
        scene.colors,
        extra,
        scene.viewmats,
    )
    differentiable = torch.is_grad_enabled() and any(
        t is not None and t.requires_grad for t in vars(inputs).values()
    )
    with torch.no_grad():
        drawing = Drawing(
            scene, inputs, limits, threads, differentiable=differentiable, absgrad=absgrad
        )
    if absgrad and len(drawing.groups) > 1:
        raise InputError(
            f"absgrad: expected at most {COLOURS + 1} channels, depth included, found "
            f"{scene.colors.shape[-1]}"
        )
    seen = (drawing.extents > 0).all(dim=-1)
    index = torch.nonzero(seen, as_tuple=True) if packed else None
    meta = _meta(scene, drawing, means2d, depths, seen, index)
    if differentiable:  # with frozen means it is a leaf, and can be watched all the same
        centres = meta["means2d"].requires_grad_()
        centres.retain_grad()
    tensors = vars(inputs).values()
    images, alphas = Composite.apply(  # type: ignore[no-untyped-call]
        drawing, index, meta["means2d"], *tensors
    )
    images = _finished(images, alphas, scene.backgrounds, render_mode)
    return _unflat(images, scene), _unflat(alphas, scene), meta


def _centres(scene: Scene, near_plane: float) -> tuple[Tensor, Tensor]:
    """Return centres on the image [B, C, N, 2], px, and depths [B, C, N], both in the graph."""
    rotation, translation = scene.viewmats[..., :3, :3], scene.viewmats[..., :3, 3]
    with torch.autocast("cpu", enabled=False):  # in bfloat16 centres are a pixel off
        local = torch.einsum("bcij,bnj->bcni", rotation, scene.means) + translation[:, :, None]
    depths = local[..., 2]
    z = torch.where(depths > near_plane, depths, torch.ones_like(depths))[..., None]
    focal = scene.Ks[:, :, [0, 1], [0, 1]][:, :, None]
    middle = scene.Ks[:, :, [0, 1], [2, 2]][:, :, None]
    return local[..., :2] / z * focal + middle, depths


def _with_depth(scene: Scene, depths: Tensor, render_mode: str) -> tuple[Scene, Tensor | None]:
    """Return the scene with depth as the last of its plain channels, or beside its harmonics."""
    if render_mode == "RGB":
        return scene, None
    if render_mode in ("D", "ED"):
        return replace(scene, sh_degree=None, colors=depths[..., None], backgrounds=None), None
    if scene.sh_degree is not None:
        return scene, depths
    colors = scene.colors if scene.per_camera else scene.colors[:, None]
    colors = colors.expand(*depths.shape, colors.shape[-1])
    return replace(scene, colors=torch.cat([colors, depths[..., None]], dim=-1)), None


def _finished(
    images: Tensor, alphas: Tensor, backgrounds: Tensor | None, render_mode: str
) -> Tensor:
    """Return the images over their backgrounds, depth divided by alpha where it is expected."""
    if backgrounds is not None:
        behind = backgrounds[:, :, None, None] * (1 - alphas)
        images = torch.cat(
            [images[..., : behind.shape[-1]] + behind, images[..., behind.shape[-1] :]], dim=-1
        )
    if render_mode in ("ED", "RGB+ED"):
        expected = images[..., -1:] / alphas.clamp(min=LEAST_ALPHA)
        images = torch.cat([images[..., :-1], expected], dim=-1)
    return images


def _meta(
    scene: Scene,
    drawing: Drawing,
    means2d: Tensor,
    depths: Tensor,
    seen: Tensor,
    index: tuple[Tensor, ...] | None,
) -> dict[str, Any]:
    """Return gsplat's dictionary; ``index`` of the splats that are seen, where it is packed."""
    of_splats = {
        "radii": torch.where(seen[..., None], drawing.extents, 0).int(),
        "means2d": means2d,
        "depths": depths,
        "opacities": scene.opacities[:, None].expand(*depths.shape),
    }
    ids: dict[str, Any] = dict.fromkeys(("batch_ids", "camera_ids", "gaussian_ids"))
    if index is None:
        of_splats = {name: _unflat(t, scene) for name, t in of_splats.items()}
    else:
        of_splats = {name: t[index] for name, t in of_splats.items()}
        ids = dict(zip(ids, index, strict=True))
    return {
        **ids,
        **of_splats,
        "width": scene.width,
        "height": scene.height,
        "n_batches": len(scene.means),
        "n_cameras": scene.cameras,
    }


def _unflat(tensor: Tensor, scene: Scene) -> Tensor:
    """Give a tensor its batch dimensions back."""
    return tensor.reshape(*scene.batch, *tensor.shape[1:])
