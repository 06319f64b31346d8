"""From a photo to the network's input, as U²-Net's reference implementation does it."""

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

IMAGENET_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
IMAGENET_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)


def network_input(
    image: NDArray[np.uint8],  # [H, W, 3] RGB
    width: int,
    height: int,
) -> NDArray[np.float32]:
    """Resize, divide by the image's own maximum, normalise; [3, height, width] float32."""
    shrinks = width < image.shape[1] and height < image.shape[0]
    if image.shape[:2] != (height, width):
        filter_ = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        image = cv2.resize(image, (width, height), interpolation=filter_)
    values = image.astype(np.float32) / max(1.0, float(image.max()))
    normalised = (values - IMAGENET_MEAN) / IMAGENET_DEVIATION
    return np.ascontiguousarray(normalised.transpose(2, 0, 1))


def network_inputs(images: "Tensor") -> "Tensor":
    """Do what ``network_input`` does to images [B, S, S, 3] uint8 of the network's own size.

    [B, 3, S, S] float32, where the images are.
    """
    import torch  # takes seconds, and only training needs it

    mean, deviation = (
        torch.from_numpy(values).to(images.device) for values in (IMAGENET_MEAN, IMAGENET_DEVIATION)
    )
    values = images.float()
    values = values / values.amax((1, 2, 3), keepdim=True).clamp(min=1)
    return ((values - mean) / deviation).permute(0, 3, 1, 2)
