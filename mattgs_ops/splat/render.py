"""Show trained splats: 8-bit renderings, and how fast they come."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.photos import WHITE
from mattgs_ops.splat.rasterize import render
from mattgs_ops.timing import stopwatch

WARM_UP = 3  # renderings before the clock runs: first touch of memory, thread start


def render_view(
    splats: Splats,
    camera: Camera,
    background: tuple[float, float, float] = WHITE,
    *,
    threads: int = 1,
) -> NDArray[np.uint8]:
    """Return the view [H, W, 3] uint8 sRGB, rounded to nearest after clamping to [0, 1]."""
    with torch.no_grad():
        image = render(splats, camera, background, threads=threads, differentiable=False).image
        pixels: NDArray[np.uint8] = image.clamp(0, 1).mul(255).round().to(torch.uint8).numpy()
    return pixels


def time_views(
    splats: Splats,
    cameras: Sequence[Camera],
    background: tuple[float, float, float] = WHITE,
    *,
    threads: int = 1,
) -> Iterator[tuple[int, float]]:
    """Yield the index of a view and the seconds that rendering it took, round after round, forever.

    Rendering to float32 in memory only: no rounding, no files. Seconds are of the clock that others
    do not disturb. A few renderings before the first one do not count. Raises :class:`ValueError`
    without a camera.
    """
    if not cameras:
        raise ValueError("time_views: expected at least one camera, found none")
    for camera in [*cameras][:WARM_UP]:
        render(splats, camera, background, threads=threads, differentiable=False)
    for index in itertools.cycle(range(len(cameras))):
        began = stopwatch.seconds()
        render(splats, cameras[index], background, threads=threads, differentiable=False)
        yield index, stopwatch.seconds() - began
