"""Compare ``rasterization`` with gsplat's own torch reference: values and gradients, side by side.

``python benchmarks/peers/gsplat_reference.py`` needs gsplat 1.5.3 (``pip install --no-deps
gsplat==1.5.3`` in an environment of its own, or unpacked somewhere on PYTHONPATH); it is no
dependency of the project. Only ``gsplat/cuda/_torch_impl.py`` is run, in float64: what that file
takes from CUDA and from nerfacc, the list of splats of each pixel and the sums along it, stands
below in plain torch.
Prints the largest differences of one scene a row. A gradient's difference is the norm of the
difference over the norm of gsplat's. A splat that is a hair to either side of alpha = 1/255 in
float32 and float64 differs by up to 1/255 in a pixel, which is what the largest ones are.
"""

import argparse
import importlib.util
import sys
import types
from pathlib import Path

import torch
from torch import Tensor

from mattgs_ops.splat import rasterization

ALPHA_MIN, ALPHA_MAX, T_MIN = 1 / 255, 0.999, 1e-4  # gsplat 1.5.3, RasterizeToPixels3DGSFwd.cu
TILE = 16
VERSION = "1.5.3"
NAMES = ("means", "quats", "scales", "opacities", "colors", "viewmats", "backgrounds")
MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
Scene = dict[str, Tensor]


def load_reference() -> types.ModuleType:
    """Run gsplat's torch reference without the rest of its package."""
    spec = importlib.util.find_spec("gsplat")
    if spec is None or not spec.submodule_search_locations:
        sys.exit(f"gsplat_reference: expected gsplat {VERSION} to be installed, found none")
    source = Path(next(iter(spec.submodule_search_locations))) / "cuda" / "_torch_impl.py"
    for name in ("gsplat", "gsplat.cuda"):
        package = types.ModuleType(name)
        package.__path__ = []
        sys.modules[name] = package
    from_cuda = types.ModuleType("gsplat.cuda._wrapper")
    from_cuda.rasterize_to_indices_in_range = splats_of_pixels  # type: ignore[attr-defined]
    nerfacc = types.ModuleType("nerfacc")
    nerfacc.render_weight_from_alpha = weights_along  # type: ignore[attr-defined]
    nerfacc.accumulate_along_rays = sums_along  # type: ignore[attr-defined]
    sys.modules |= {"gsplat.cuda._wrapper": from_cuda, "nerfacc": nerfacc}
    found = importlib.util.spec_from_file_location("gsplat.cuda._torch_impl", source)
    assert found is not None, source
    assert found.loader is not None, source
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


@torch.no_grad()
def splats_of_pixels(
    start: int,  # noqa: ARG001 - splats come in one batch
    end: int,  # noqa: ARG001
    transmittances: Tensor,
    means2d: Tensor,
    conics: Tensor,
    opacities: Tensor,
    width: int,
    height: int,
    tile_size: int,
    offsets: Tensor,
    flatten_ids: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return splat, pixel and image of every blended pair, in the order of blending."""
    images = means2d.shape[0]
    count = means2d.shape[1]
    ends = torch.cat([offsets.flatten()[1:], torch.tensor([len(flatten_ids)])])
    ends = ends.reshape(offsets.shape)
    found: list[tuple[Tensor, Tensor, Tensor]] = []
    for image in range(images):
        for ty in range(offsets.shape[1]):
            for tx in range(offsets.shape[2]):
                first, last = int(offsets[image, ty, tx]), int(ends[image, ty, tx])
                ids = flatten_ids[first:last].long() - image * count
                rows = torch.arange(ty * tile_size, min((ty + 1) * tile_size, height))
                columns = torch.arange(tx * tile_size, min((tx + 1) * tile_size, width))
                y, x = torch.meshgrid(rows, columns, indexing="ij")
                y, x = y.flatten(), x.flatten()
                delta = torch.stack([x + 0.5, y + 0.5], -1) - means2d[image, ids][:, None]
                a, b, c = conics[image, ids].unbind(-1)
                power = 0.5 * (a[:, None] * delta[..., 0] ** 2 + c[:, None] * delta[..., 1] ** 2)
                power = power + b[:, None] * delta[..., 0] * delta[..., 1]
                alpha = (opacities[image, ids][:, None] * (-power).exp()).clamp(max=ALPHA_MAX)
                alpha = torch.where((power >= 0) & (alpha >= ALPHA_MIN), alpha, 0)
                after = transmittances[image, y, x] * torch.cumprod(1 - alpha, dim=0)
                blended = (alpha > 0) & (after > T_MIN)
                pixel, splat = torch.nonzero(blended.T, as_tuple=True)
                pixels = (y * width + x)[pixel]
                found.append((ids[splat], pixels, torch.full_like(pixels, image)))
    splats, pixels, of_image = (torch.cat(parts) for parts in zip(*found, strict=True))
    return splats, pixels, of_image


def weights_along(alphas: Tensor, ray_indices: Tensor, n_rays: int) -> tuple[Tensor, Tensor]:
    """Return blending weights and transmittances [M] of pairs sorted by ray, front to back."""
    del n_rays
    logs = torch.log1p(-alphas)
    before = torch.cumsum(logs, 0) - logs
    begins = torch.ones_like(ray_indices, dtype=torch.bool)
    begins[1:] = ray_indices[1:] != ray_indices[:-1]
    first = torch.nonzero(begins)[:, 0][torch.cumsum(begins, 0) - 1]
    transmittance = (before - before[first]).exp()
    return transmittance * alphas, transmittance


def sums_along(weights: Tensor, values: Tensor | None, ray_indices: Tensor, n_rays: int) -> Tensor:
    """Return the sums [n_rays, channels] of weight times value."""
    terms = weights[:, None] if values is None else weights[:, None] * values
    return torch.zeros(n_rays, terms.shape[1]).index_add(0, ray_indices, terms)


def gsplat_renders(
    reference: types.ModuleType,
    scene: Scene,
    width: int,
    height: int,
    degree: int | None,
    mode: str,
) -> tuple[Tensor, Tensor]:
    """Compose gsplat's reference functions as its ``rasterization`` does, all in float64."""
    means, viewmats = scene["means"], scene["viewmats"]
    covars, _ = reference._quat_scale_to_covar_preci(scene["quats"], scene["scales"], True, False)
    radii, means2d, depths, conics, _ = reference._fully_fused_projection(
        means, covars, viewmats, scene["Ks"], width, height
    )
    cameras = len(viewmats)
    opacities = scene["opacities"].expand(cameras, -1)
    if degree is None:
        colors = scene["colors"].expand(cameras, *scene["colors"].shape)
    else:
        directions = means - torch.inverse(viewmats)[:, None, :3, 3]
        coefficients = scene["colors"].expand(cameras, *scene["colors"].shape)
        colors = reference._spherical_harmonics(degree, directions, coefficients)
        colors = torch.clamp_min(colors + 0.5, 0)
    backgrounds = scene["backgrounds"]
    none = backgrounds.new_zeros(cameras, 1)
    if mode in ("RGB+D", "RGB+ED"):
        colors = torch.cat([colors, depths[..., None]], -1)
        backgrounds = torch.cat([backgrounds, none], -1)
    elif mode != "RGB":
        colors, backgrounds = depths[..., None], none
    tiles = (-(-width // TILE), -(-height // TILE))
    _, ids, flatten_ids = reference._isect_tiles(
        means2d.detach(), radii, depths.detach(), TILE, *tiles
    )
    offsets = reference._isect_offset_encode(ids, cameras, *tiles)
    images, alphas = reference._rasterize_to_pixels(
        means2d, conics, colors, opacities, width, height, TILE, offsets, flatten_ids, backgrounds
    )
    if mode.endswith("ED"):
        expected = images[..., -1:] / alphas.clamp(min=1e-10)
        images = torch.cat([images[..., :-1], expected], -1)
    return images, alphas


def random_scene(seed: int, count: int, degree: int | None, *, near: bool) -> Scene:
    """Return splats before two cameras; ``near`` as gsplat's tests have them, from the lens on."""
    g = torch.Generator().manual_seed(seed)
    viewmats = torch.eye(4).repeat(2, 1, 1)
    if near:  # gsplat's tests/test_rasterization.py: a unit cube that the camera looks along
        means, size = torch.rand(count, 3, generator=g), 0.1
    else:
        means, size = torch.randn(count, 3, generator=g) + torch.tensor([0, 0, 5.0]), 0.3
        turn = torch.tensor(0.2)
        viewmats[1, 0, 0] = viewmats[1, 2, 2] = torch.cos(turn)
        viewmats[1, 0, 2], viewmats[1, 2, 0] = torch.sin(turn), -torch.sin(turn)
        viewmats[1, :3, 3] = torch.tensor([-0.7, 0.2, 0.4])
    shape = (count, 3) if degree is None else (count, (degree + 1) ** 2, 3)
    return {
        "means": means,
        "quats": torch.randn(count, 4, generator=g),
        "scales": torch.rand(count, 3, generator=g) * size,
        "opacities": torch.rand(count, generator=g),
        "colors": torch.rand(shape, generator=g) - (0 if degree is None else 0.3),
        "viewmats": viewmats,
        "Ks": torch.tensor([[60.0, 0, 30], [0, 60, 20], [0, 0, 1]]).repeat(2, 1, 1),
        "backgrounds": torch.rand(2, 3, generator=g),
    }


def compare(
    reference: types.ModuleType, scene: Scene, degree: int | None, mode: str
) -> tuple[float, float, dict[str, float]]:
    """Return the largest and the mean difference of values, and those of each gradient."""
    width, height = 60, 40
    ours = {k: v.clone().requires_grad_(k in NAMES) for k, v in scene.items()}
    theirs = {k: v.double().requires_grad_(k in NAMES) for k, v in scene.items()}
    found = rasterization(**ours, width=width, height=height, sh_degree=degree, render_mode=mode)
    torch.set_default_dtype(torch.float64)
    expected = gsplat_renders(reference, theirs, width, height, degree, mode)
    torch.set_default_dtype(torch.float32)
    g = torch.Generator().manual_seed(1)
    upstream = [torch.randn(t.shape, generator=g) for t in found[:2]]
    torch.autograd.backward(found[:2], upstream)
    torch.autograd.backward(expected, [one.double() for one in upstream])
    values = torch.cat([(a - b).abs().flatten() for a, b in zip(found[:2], expected, strict=True)])
    gradients = {}
    for name in NAMES:
        mine, gsplats = ours[name].grad, theirs[name].grad
        if gsplats is None or float(gsplats.norm()) == 0:
            continue
        assert mine is not None, name
        gradients[name] = float((mine - gsplats).norm() / gsplats.norm())
    return float(values.detach().max()), float(values.detach().mean()), gradients


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--splats", type=int, default=150)
    parser.add_argument("--seeds", type=int, default=2)
    arguments = parser.parse_args()
    reference = load_reference()
    print(f"| scene | mode | colours | largest | mean | {' | '.join(NAMES)} |")
    print("|---" * (5 + len(NAMES)) + "|")
    for near in (False, True):
        for mode in MODES:
            for degree in (None, 3):
                for seed in range(arguments.seeds):
                    scene = random_scene(seed, arguments.splats, degree, near=near)
                    largest, mean, gradients = compare(reference, scene, degree, mode)
                    cells = [f"{gradients[n]:.1e}" if n in gradients else "" for n in NAMES]
                    kind = "plain" if degree is None else f"SH {degree}"
                    place = f"{'unit cube' if near else 'before'} {seed}"
                    row = [place, mode, kind, f"{largest:.1e}", f"{mean:.1e}", *cells]
                    print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
