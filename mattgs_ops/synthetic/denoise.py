"""Removing the path tracer's noise without touching textures.

The light that falls on a surface varies slowly, its colour does not. So the traced radiance is
divided by the surface's colour, which the renderer gives without noise, smoothed by an à-trous
filter (Dammertz et al. 2010) that stops at edges of orientation and depth and at differences of
light larger than the noise, and multiplied again.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

FLOOR = 0.03  # added to the colour, so that black surfaces do not blow up their reflections
STEPS = (1, 2, 4, 8)
NORMAL_SIGMA = 0.12
DEPTH_SIGMA = 0.012  # of the depth, per pixel of distance
LIGHT_SIGMA = 2.2  # standard deviations of the local noise


def denoise(light: Floats, albedo: Floats, normal: Floats, depth: Floats) -> Floats:
    """Smooth ``light`` [H, W, 3]; ``albedo`` and ``normal`` [H, W, 3], ``depth`` [H, W, 1]."""
    colour = np.clip(albedo, 0, 1) + FLOOR
    irradiance = _without_fireflies(light / colour)
    for step in STEPS:
        irradiance = _smooth(irradiance, normal, depth, step)
    irradiance = _without_specks(irradiance)
    return np.asarray(irradiance * colour, dtype=np.float32)


def _without_fireflies(values: Floats) -> Floats:
    """Limit each pixel to three times its neighbourhood's median."""
    median = np.stack(
        [cv2.medianBlur(np.ascontiguousarray(c), 5) for c in np.moveaxis(values, 2, 0)]
    )
    return np.minimum(values, 3 * np.moveaxis(median, 0, 2) + 0.05)


def _without_specks(values: Floats) -> Floats:
    """Bring single pixels, which edges left unsmoothed, into the range of their neighbours."""
    ring = np.ones((3, 3), dtype=np.uint8)
    ring[1, 1] = 0
    return np.asarray(np.clip(values, cv2.erode(values, ring), cv2.dilate(values, ring)))


def _smooth(values: Floats, normal: Floats, depth: Floats, step: int) -> Floats:
    luminance = values.mean(axis=2)
    mean = cv2.blur(luminance, (5, 5))
    spread = np.sqrt(np.maximum(cv2.blur(luminance**2, (5, 5)) - mean**2, 0)) * LIGHT_SIGMA + 0.004
    total = np.zeros_like(values)
    weights = np.zeros_like(luminance)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            kernel = (2 - abs(dx)) * (2 - abs(dy))
            other = _shift(values, dx * step, dy * step)
            bend = ((_shift(normal, dx * step, dy * step) - normal) ** 2).sum(axis=2)
            apart = np.abs(_shift(depth, dx * step, dy * step) - depth)[..., 0]
            reach = DEPTH_SIGMA * depth[..., 0] * step + 1e-3
            differs = np.abs(other.mean(axis=2) - luminance) / spread
            weight = kernel * np.exp(-bend / NORMAL_SIGMA**2 - apart / reach - differs)
            total += weight[..., None] * other
            weights += weight
    return np.asarray(total / weights[..., None], dtype=np.float32)


def _shift(values: Floats, dx: int, dy: int) -> Floats:
    height, width = values.shape[:2]
    rows = np.clip(np.arange(height) + dy, 0, height - 1)
    columns = np.clip(np.arange(width) + dx, 0, width - 1)
    return values[rows[:, None], columns[None]]
