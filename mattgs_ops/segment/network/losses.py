"""Losses of U²-Net: the sum over its seven outputs, all weights 1 (eq. 1 of the U²-Net paper).

``bce`` is binary cross-entropy averaged over pixels; ``bce_dice`` adds the Dice loss
``1 - (2 Σ p g + 1) / (Σ p + Σ g + 1)`` per image (eq. 2 of the MATT-GS paper).
"""

from collections.abc import Sequence
from typing import Literal

from torch import Tensor
from torch.nn import functional

SMOOTH = 1.0  # pixels; keeps an image without object or prediction at Dice 1


def segmentation_loss(
    logits: Sequence[Tensor], truth: Tensor, kind: Literal["bce", "bce_dice"] = "bce"
) -> Tensor:
    """Logit maps [B, 1, H, W] and truth [B, 1, H, W] in 0..1 to a scalar."""
    total = truth.new_zeros(())
    for output in logits:
        total = total + functional.binary_cross_entropy_with_logits(output, truth)
        if kind == "bce_dice":
            total = total + dice_loss(output.sigmoid(), truth)
    return total


def dice_loss(probability: Tensor, truth: Tensor) -> Tensor:
    """[B, 1, H, W] both, in 0..1, to a scalar in 0..1, averaged over images."""
    overlap = (probability * truth).sum((1, 2, 3))
    areas = probability.sum((1, 2, 3)) + truth.sum((1, 2, 3))
    return (1 - (2 * overlap + SMOOTH) / (areas + SMOOTH)).mean()
