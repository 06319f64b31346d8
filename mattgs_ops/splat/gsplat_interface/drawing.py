"""Every camera of every scene, rendered once by the compiled engine, and the way back.

The engine composites up to four channels at a time, so more take several passes over the same
splats.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mattgs_ops.errors import InputError
from mattgs_ops.splat import _engine
from mattgs_ops.splat.gsplat_interface.arguments import Limits, Scene
from mattgs_ops.splat.harmonics import SH_REST

GSPLAT_ALPHA_MAX = 0.999  # gsplat 1.5.3, RasterizeToPixels3DGSFwd.cu; 3DGS has 0.99
COLOURS = 3  # channels that the engine always composites
CAMERA_SUMS = 15  # dL/d rotation [9], translation [3], centre [3]
Key = tuple[int, int, int]  # scene, camera, pass
BLACK = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Inputs:
    """What the engine reads; the names of gradients, too."""

    means: Tensor  # [B, N, 3]
    quats: Tensor  # [B, N, 4]
    scales: Tensor  # [B, N, 3]
    opacities: Tensor  # [B, N]
    colors: Tensor  # as in Scene, plain ones with the depth among them where it is asked for
    extra: Tensor | None  # [B, C, N] the depth beside harmonics
    viewmats: Tensor  # [B, C, 4, 4]


class Drawing:
    """All cameras of all scenes, rendered once; lives until the graph is freed."""

    def __init__(
        self,
        scene: Scene,
        inputs: Inputs,
        limits: Limits,
        threads: int,
        *,
        differentiable: bool,
        absgrad: bool,
    ) -> None:
        self.scene, self.limits, self.threads = scene, limits, threads
        self.differentiable, self.absgrad = differentiable, absgrad
        self.plain = scene.sh_degree is None
        # plain channels in groups of four; harmonics make three, and the depth is the fourth
        channels, most = inputs.colors.shape[-1] + int(inputs.extra is not None), COLOURS + 1
        self.groups = [slice(i, min(i + most, channels)) for i in range(0, channels, most)]
        shape = (len(inputs.means), scene.cameras)
        self.images = _empty(*shape, scene.height, scene.width, channels)
        self.alphas = _empty(*shape, scene.height, scene.width, 1)
        self.extents = _empty(*shape, scene.count, 2)
        # engine, its parameters and its fourth channel: what going back needs
        self._drawn: dict[Key, tuple[Any, tuple[Any, ...], Any]] = {}
        for key in self.passes():
            self._draw(inputs, key)

    def passes(self) -> Iterator[Key]:
        """Yield every image of every pass."""
        scenes, cameras = self.extents.shape[:2]
        return itertools.product(range(scenes), range(cameras), range(len(self.groups)))

    def handed_out(self) -> tuple[Tensor, Tensor]:
        """Return images and alphas and forget them: they will hold the graph that holds this."""
        drawn = self.images, self.alphas
        del self.images, self.alphas
        return drawn

    def _draw(self, inputs: Inputs, key: Key) -> None:
        b, c, p = key
        scene, group = self.scene, self.groups[p]
        view, k = inputs.viewmats[b, c].double(), scene.Ks[b, c].double()
        limits = self.limits
        engine = _engine.Rendering(
            view[:3, :3].flatten().tolist(),
            view[:3, 3].tolist(),
            (float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])),
            scene.width,
            scene.height,
            BLACK,
            scene.sh_degree or 0,
            self.threads,
            self.differentiable,
            (
                torch.linalg.inv(view)[:3, 3].tolist(),
                (
                    limits.near_plane,
                    limits.far_plane,
                    limits.eps2d,
                    GSPLAT_ALPHA_MAX,
                    limits.radius_clip,
                ),
                self.plain,
            ),
        )
        splats, extra = self._arrays(inputs, key)
        if extra is not None and not np.isfinite(extra).all():
            raise InputError(_describe_not_finite(inputs))  # the engine looks at the other three
        channels = COLOURS if extra is None else COLOURS + 1
        image = _empty(scene.height, scene.width, channels)
        bad = engine.forward(
            splats,
            image.numpy(),
            self.alphas[b, c, :, :, 0].numpy(),
            _empty(scene.count).numpy(),
            _empty(scene.count, 2).numpy(),
            self.extents[b, c].numpy(),
            extra,
        )
        if bad:
            raise InputError(_describe_not_finite(inputs))
        self.images[b, c, :, :, group] = image[:, :, : group.stop - group.start]
        if self.differentiable:
            self._drawn[key] = engine, splats, extra

    def _arrays(self, inputs: Inputs, key: Key) -> tuple[tuple[Any, ...], Any]:
        """Return the parameters in the engine's order, and the fourth channel [N] or None."""
        b, c, p = key
        colors = inputs.colors[b, c] if self.scene.per_camera else inputs.colors[b]
        rest = _empty(0, SH_REST, 3)
        if self.plain:
            chosen = colors[:, self.groups[p]]
            first = colors.new_zeros(len(colors), COLOURS)
            first[:, : chosen.shape[1]] = chosen[:, :COLOURS]
            extra = chosen[:, COLOURS].contiguous() if chosen.shape[1] > COLOURS else None
        else:
            first = colors[:, 0].contiguous()
            if self.scene.sh_degree:
                used = min(colors.shape[1] - 1, SH_REST)
                rest = colors.new_zeros(len(colors), SH_REST, 3)
                rest[:, :used] = colors[:, 1 : 1 + used]
            extra = None if inputs.extra is None else inputs.extra[b, c].contiguous()
        geometry = (inputs.means[b], inputs.scales[b], inputs.quats[b], inputs.opacities[b])
        splats = (*(t.contiguous().numpy() for t in geometry), first.numpy(), rest.numpy())
        return splats, None if extra is None else extra.numpy()

    def back(
        self, key: Key, grad_image: Tensor, grad_alpha: Tensor, *, camera: bool
    ) -> "ImageGradients":
        """Return the gradients of one image; ``grad_alpha`` counts in its first pass.

        Without ``camera`` its sums are undefined, without ``absgrad`` so are the absolute ones.
        """
        b, c, p = key
        engine, splats, extra = self._drawn[key]
        pixels = grad_image[b, c, :, :, self.groups[p]]
        missing = (COLOURS if extra is None else COLOURS + 1) - pixels.shape[-1]
        grads = ImageGradients.taken(
            self.scene.count, rest=not self.plain and bool(self.scene.sh_degree)
        )
        engine.backward(
            splats,
            torch.nn.functional.pad(pixels, (0, missing)).contiguous().numpy(),
            grad_alpha[b, c, :, :, 0].contiguous().numpy() if p == 0 else None,
            None,
            grads.parameters(),
            grads.statistics(all_of_them=self.absgrad),
            self.absgrad,
            None if extra is None else grads.extra.numpy(),
            grads.camera.numpy() if camera else None,
        )
        return grads


@dataclass(frozen=True)
class ImageGradients:
    """Gradients of one image, as the engine writes them."""

    means: Tensor  # [N, 3]
    scales: Tensor  # [N, 3]
    quats: Tensor  # [N, 4]
    opacities: Tensor  # [N]
    first: Tensor  # [N, 3] the constant harmonic, or three plain channels
    rest: Tensor  # [N, 15, 3] or [0, 15, 3]
    extra: Tensor  # [N]
    means2d: Tensor  # [N, 2]
    absolute: Tensor  # [N, 2] the same with absolute values summed over pixels
    camera: Tensor  # [CAMERA_SUMS] float64

    @classmethod
    def taken(cls, count: int, *, rest: bool) -> "ImageGradients":
        """Return uninitialised ones."""
        return cls(
            means=_empty(count, 3),
            scales=_empty(count, 3),
            quats=_empty(count, 4),
            opacities=_empty(count),
            first=_empty(count, 3),
            rest=_empty(count if rest else 0, SH_REST, 3),
            extra=_empty(count),
            means2d=_empty(count, 2),
            absolute=_empty(count, 2),
            camera=torch.empty(CAMERA_SUMS, dtype=torch.float64, device="cpu"),
        )

    def parameters(self) -> tuple[Any, ...]:
        """Return those of the parameters as NumPy arrays, in the engine's order."""
        of_splats = (self.means, self.scales, self.quats, self.opacities, self.first, self.rest)
        return tuple(t.numpy() for t in of_splats)

    def statistics(self, *, all_of_them: bool) -> tuple[Any, ...]:
        """Return what the engine observes of each splat; blending weights are of no use here."""
        count = len(self.means) if all_of_them else 0
        unused = _empty(2, count)
        observed = (self.means2d, self.absolute[:count], unused[0], unused[1])
        return tuple(t.numpy() for t in observed)


def _empty(*shape: int) -> Tensor:
    """Return an uninitialised tensor of the engine's type, whatever torch's defaults are."""
    return torch.empty(shape, dtype=torch.float32, device="cpu")


def _describe_not_finite(inputs: Inputs) -> str:
    for name, tensor in vars(inputs).items():
        if tensor is not None and not bool(torch.isfinite(tensor).all()):
            return f"{name}: expected finite numbers, found NaN or infinity"
    return "colors: expected harmonics that give finite colours, found an overflow"
