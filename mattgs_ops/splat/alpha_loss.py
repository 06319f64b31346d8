"""The alpha loss: where the background was removed the mask says how opaque a pixel is.

``loss = strength * mean(w * |alpha - mask|)`` over the pixels of a view. Photo and rendering on one
colour cannot tell a splat of that colour from emptiness; this term can, and so can a new colour in
every step (``background = "random"``), which it makes sharper. The same as nerfstudio's and
others' mask losses, but for the weights: w is 1, or what the pixel weighs in ``residual``.
"""

from torch import Tensor


def alpha_loss(
    alpha: Tensor, mask: Tensor, strength: float, weight: Tensor | None = None
) -> tuple[float, Tensor]:
    """Return the loss and dL/d alpha [H, W].

    ``alpha`` and ``mask`` [H, W] float32 in [0, 1], ``weight`` [H, W] or none. The gradient of
    ``|d|`` at 0 is 0.
    """
    difference = alpha - mask
    grad = difference.sign().mul_(strength / difference.numel())
    if weight is not None:
        grad *= weight
    return float((grad * difference).sum()), grad
