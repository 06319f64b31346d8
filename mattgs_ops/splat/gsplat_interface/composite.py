"""The compiled engine as a node of torch's autograd graph.

:class:`Composite` hands out the images of a :class:`~drawing.Drawing` and goes back through the
engine. Gradients of its cameras and passes add up, as all are linear in those of the pixels.

The way back stops at the splats' centres on the image (``means2d``) and at their depths, which
``rasterization`` computes in torch: they are then tensors that a caller can watch, as in gsplat.
"""

from typing import Any

import torch
from torch import Tensor

from mattgs_ops.splat.gsplat_interface.drawing import COLOURS, Drawing, ImageGradients, Inputs, Key
from mattgs_ops.splat.harmonics import SH_REST


class Sums:
    """Gradients summed over cameras and passes; shaped like :class:`Inputs`."""

    def __init__(self, inputs: Inputs, drawing: Drawing, *, camera: bool) -> None:
        self.inputs, self.drawing, self.camera = inputs, drawing, camera
        self.of = {n: torch.zeros_like(t) for n, t in vars(inputs).items() if t is not None}
        self.means2d = torch.zeros_like(drawing.extents)
        self.absolute = torch.zeros_like(drawing.extents)

    def add(self, grads: ImageGradients, key: Key) -> None:
        """Add the gradients of one image."""
        b, c, _ = key
        for name in ("means", "quats", "scales", "opacities"):
            self.of[name][b] += getattr(grads, name)
        self._add_colours(grads, key)
        self.means2d[b, c] += grads.means2d
        if self.camera:
            self.of["viewmats"][b, c] += view_gradient(grads.camera, self.inputs.viewmats[b, c])
        if self.drawing.absgrad:
            self.absolute[b, c] += grads.absolute

    def _add_colours(self, grads: ImageGradients, key: Key) -> None:
        b, c, p = key
        drawing, colors = self.drawing, self.of["colors"][b]
        if drawing.scene.per_camera:
            colors = colors[c]
        if drawing.plain:
            group = drawing.groups[p]
            size = group.stop - group.start
            colors[:, group.start : group.start + COLOURS][:, :size] += grads.first[:, :size]
            if size > COLOURS:
                colors[:, group.stop - 1] += grads.extra
            return
        colors[:, 0] += grads.first
        if len(grads.rest):
            colors[:, 1 : 1 + SH_REST] += grads.rest[:, : colors.shape[1] - 1]
        if "extra" in self.of:
            self.of["extra"][b, c] += grads.extra


class Composite(torch.autograd.Function):
    """Images [B, C, H, W, D] and alphas [B, C, H, W, 1] of a :class:`Drawing`."""

    @staticmethod
    def forward(
        ctx: Any,
        drawing: Drawing,
        index: tuple[Tensor, ...] | None,
        means2d: Tensor,
        *tensors: Tensor | None,
    ) -> tuple[Tensor, Tensor]:
        """Return what was drawn from ``tensors``, those of :class:`Inputs` in order.

        ``means2d`` is [..., C, N, 2], or [nnz, 2] with the ``index`` of its rows; its values are of
        no consequence, it is there for its gradient. After the way back it has the attribute
        ``absgrad``, shaped like it.
        """
        ctx.drawing, ctx.index = drawing, index
        ctx.save_for_backward(means2d, *tensors)
        return drawing.handed_out()

    @staticmethod
    def backward(ctx: Any, grad_image: Tensor, grad_alpha: Tensor) -> Any:
        """Return the gradients in the order of the arguments of :meth:`forward`.

        Where a graph of them is asked for, it ends in :class:`NoSecondDerivative`. (A node that
        torch's ``once_differentiable`` marks is passed by on the way through centres and depths.)
        """
        with torch.no_grad():
            grads = Composite._first(ctx, grad_image, grad_alpha)
        if not torch.is_grad_enabled():
            return grads
        known = [grad for grad in grads if grad is not None]
        causes = (grad_image, grad_alpha, *(t for t in ctx.saved_tensors if t is not None))
        marked = NoSecondDerivative.apply(len(known), *known, *causes)  # type: ignore[no-untyped-call]
        rest = iter(marked)
        return tuple(None if grad is None else next(rest) for grad in grads)

    @staticmethod
    def _first(ctx: Any, grad_image: Tensor, grad_alpha: Tensor) -> tuple[Tensor | None, ...]:
        means2d, *tensors = ctx.saved_tensors
        inputs, drawing = Inputs(*tensors), ctx.drawing
        camera = ctx.needs_input_grad[-1]
        sums = Sums(inputs, drawing, camera=camera)
        for key in drawing.passes():
            sums.add(drawing.back(key, grad_image, grad_alpha, camera=camera), key)
        index = slice(None) if ctx.index is None else ctx.index
        centres = sums.means2d[index].reshape(means2d.shape)
        if drawing.absgrad:
            means2d.absgrad = sums.absolute[index].reshape(means2d.shape)
        return (None, None, centres, *(sums.of.get(name) for name in vars(inputs)))


class NoSecondDerivative(torch.autograd.Function):
    """Hands gradients on, and raises where somebody differentiates them by what they came of."""

    @staticmethod
    def forward(_ctx: Any, count: int, *tensors: Tensor) -> tuple[Tensor, ...]:
        """Return the first ``count`` tensors; the others are what they depend on."""
        return tuple(tensor.view_as(tensor) for tensor in tensors[:count])

    @staticmethod
    def backward(_ctx: Any, *_grads: Tensor) -> Any:
        """Raise: the engine has first derivatives only."""
        raise RuntimeError(
            "rasterization: second derivatives are not supported; expected create_graph=False"
        )


def view_gradient(sums: Tensor, view: Tensor) -> Tensor:
    """Return dL/d view matrix [4, 4] from the engine's sums."""
    inverse: Tensor = torch.linalg.inv(view.double())
    by_inverse = torch.zeros_like(inverse)
    by_inverse[:3, 3] = sums[12:15]  # the centre is the inverse's last column
    grad: Tensor = -inverse.T @ by_inverse @ inverse.T
    grad[:3, :3] += sums[:9].view(3, 3)
    grad[:3, 3] += sums[9:12]
    return grad.float()
