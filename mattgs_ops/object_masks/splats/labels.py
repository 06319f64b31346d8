"""Labels of splats: the mean vote of the views' maps on each, and how a camera sees them.

A view's vote on a splat is the mean saliency of the pixels that the splat colours: Σ blending
weight × map / Σ blending weight, from the rasteriser (``tally``). ``render_labels`` shows labels to
a camera, without splats far in front of the object, so that a floater before a camera hides
nothing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import SoftMap, read_map
from mattgs_ops.object_masks.splats import ground_plane
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_CONSTANT
from mattgs_ops.splat.rasterize import backward, render

CERTAIN = 0.5  # mean vote from which on a splat is object
FRONT = 2.0  # radii before the object's middle, beyond which a splat is no part of it
BLACK = (0.0, 0.0, 0.0)
INVISIBLE = -30.0  # opacity before the sigmoid: 1e-13, far below what a pixel of 8 bits shows
UNSEEN = 1e-6  # blending weight, pixels: no view sees such a splat
UNSEEN_BY_OTHERS = 1e-3  # the same where one view's weight is taken off, and rounding is left

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Place:
    """Where the object is: middle [3] and radius in world units, and the ground, if any.

    Nothing farther than ``reach`` from the middle, in world units, belongs to it.
    """

    middle: NDArray[np.float64]
    radius: float
    ground: ground_plane.Plane | None
    reach: float = math.inf


@dataclass(frozen=True)
class Tally:
    """Blending weights [V, N], and weights times map [V, N], of splats in views."""

    weight: Floats
    weighted_map: Floats

    def labels(self, without: int | None = None) -> Floats:
        """Return each splat's mean vote [N], 0 where no view sees it; ``without`` one view."""
        weight, total = self.weight.sum(axis=0), self.weighted_map.sum(axis=0)
        if without is not None:
            weight, total = weight - self.weight[without], total - self.weighted_map[without]
        found: Floats = np.where(weight > UNSEEN_BY_OTHERS, total / weight.clip(min=UNSEEN), 0)
        return found.astype(np.float32)

    def among(self, possible: NDArray[np.bool_]) -> "Tally":
        """Return the votes with none for splats that are not ``possible`` [N]."""
        if possible.all():
            return self
        return replace(self, weighted_map=np.where(possible, self.weighted_map, np.float32(0)))


def tally(
    splats: Splats, cameras: Sequence[Camera], maps: Sequence[SoftMap], *, threads: int = 1
) -> Tally:
    """Return the votes of V views on N splats: the saliency of the pixels that each splat colours.

    ``maps`` are [H, W] in [0, 1] of any size; they are shrunk to the cameras' sizes.
    """
    weights, totals = [], []
    for camera, soft in zip(cameras, maps, strict=True):
        small = torch.from_numpy(shrunk(soft, camera))
        shown = render(splats, camera, BLACK, sh_degree=0, threads=threads)
        seen = backward(shown, torch.zeros_like(shown.image), pixel_map=small).observed
        weights.append(seen.weight.numpy().copy())
        totals.append(seen.weighted_map.numpy().copy())
    return Tally(np.stack(weights), np.stack(totals))


def shrunk(soft: SoftMap, camera: Camera) -> SoftMap:
    """Shrink a map to a camera's size by an area filter."""
    size = camera.intrinsics.width, camera.intrinsics.height
    small: SoftMap = cv2.resize(soft, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return small


def read_shrunk(path: Path, camera: Camera) -> SoftMap:
    """Read a map or mask [H, W] in [0, 1] at a camera's size."""
    return shrunk((read_map(path) / np.float32(255)).astype(np.float32), camera)


def render_labels(
    splats: Splats, labels: Sequence[Floats], camera: Camera, place: Place, *, threads: int = 1
) -> list[SoftMap]:
    """Render up to three labels [N] of each splat as a camera sees them, black where nothing is.

    Each becomes a map [H, W] in [0, 1]; they are the channels of one rendering.
    """
    depths = camera.depths(splats.means.numpy().astype(np.float64))
    near = camera.depths(place.middle[None])[0] - FRONT * place.radius
    behind = torch.from_numpy(depths > near)
    grey = torch.zeros(len(splats), 3)
    for channel, label in enumerate(labels):
        grey[:, channel] = torch.from_numpy(label)
    painted = replace(
        splats,
        sh_dc=(grey - 0.5) / SH_CONSTANT,
        opacity_logits=torch.where(behind, splats.opacity_logits, INVISIBLE),
    )
    shown = render(painted, camera, BLACK, sh_degree=0, threads=threads, differentiable=False)
    channels = shown.image.clamp(0, 1).permute(2, 0, 1).contiguous()
    return list(channels.numpy()[: len(labels)])
