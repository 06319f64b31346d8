"""Show trained splats: 8-bit renderings, and how fast they come."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops import stopwatch
from mattgs_ops.camera import Camera
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.photos import WHITE
from mattgs_ops.splat.rasterize import render

WARM_UP = 3  # renderings before the clock runs: first touch of memory, thread start
FEWEST_SECONDS = 0.5  # passes over the views repeat until this much was measured


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


def measure_fps(
    splats: Splats,
    cameras: Sequence[Camera],
    background: tuple[float, float, float] = WHITE,
    *,
    threads: int = 1,
    fewest_seconds: float = FEWEST_SECONDS,
) -> float:
    """Return frames per second of forward rendering: views, divided by seconds in all.

    The mean of the seconds is inverted once (the mean of frames per second would be larger).
    Rendering to float32 in memory only: no rounding, no files. Passes over the views repeat until
    ``fewest_seconds`` were measured, of the clock that others do not disturb.
    """
    if not cameras:
        raise ValueError("measure_fps: expected at least one camera, found none")
    with torch.no_grad():
        for camera in [*cameras][:WARM_UP]:
            render(splats, camera, background, threads=threads, differentiable=False)
        frames, began = 0, stopwatch.seconds()
        while True:
            for camera in cameras:
                render(splats, camera, background, threads=threads, differentiable=False)
            frames += len(cameras)
            seconds = stopwatch.seconds() - began
            if seconds >= fewest_seconds:
                return frames / seconds
