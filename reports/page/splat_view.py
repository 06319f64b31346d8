"""Splats small enough to travel inside a page: chosen, quantised to 16 bytes each, base64.

Layout, one array after the other, ``count`` entries each: position 3 × uint16 over the box,
logarithm of scale 3 × uint8 over its range, x y z of the unit quaternion with w ≥ 0 as int8 / 127,
colour 3 × uint8, opacity uint8. The colour is the constant term of the spherical harmonics: what
changes with the viewing direction is left out, and a caption has to say so.
"""

import base64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.scene import Scene
from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.ply_arrays import read_arrays
from mattgs_ops.splat.harmonics import SH_CONSTANT

Floats = NDArray[np.float64]
MOST = 20_000  # splats kept per model
LEAST_ALPHA = 1 / 255  # below this a splat is never drawn


def pack(path: Path, most: int = MOST) -> dict[str, Any]:
    """Read a PLY and return the JSON that the viewer decodes."""
    splats = read_arrays(path)
    means, scales, quaternions, logits, harmonics = (
        splats[name].astype(np.float64)
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc")
    )
    alpha = 1 / (1 + np.exp(-logits))
    colour = np.clip(0.5 + SH_CONSTANT * harmonics, 0, 1)
    kept = choose(scales, alpha, most)
    if not len(kept):
        raise InputError(f"{path}: expected at least one visible splat, found none")
    means, scales, alpha, colour = means[kept], scales[kept], alpha[kept], colour[kept]
    low, high = means.min(axis=0), means.max(axis=0)
    least, top = float(scales.min()), float(scales.max())
    data = b"".join(
        (
            _levels(means, low, high, 65535).astype("<u2").tobytes(),
            _levels(scales, least, top, 255).astype(np.uint8).tobytes(),
            _turns(quaternions[kept]).tobytes(),
            np.rint(colour * 255).astype(np.uint8).tobytes(),
            np.rint(alpha * 255).astype(np.uint8).tobytes(),
        )
    )
    return {
        "count": len(kept),
        "total": len(logits),
        "box": [_rounded(low), _rounded(high)],
        "scales": [least, top],
        "data": base64.b64encode(data).decode("ascii"),
    }


def choose(log_scales: Floats, alpha: Floats, most: int) -> NDArray[np.int64]:
    """Return the places of the splats that cover most: opacity times the two larger axes."""
    visible = np.flatnonzero(alpha >= LEAST_ALPHA)
    if len(visible) <= most:
        return visible
    sizes = np.sort(log_scales[visible], axis=1)[:, 1:].sum(axis=1)
    weight = np.log(alpha[visible]) + sizes
    best = np.argsort(-weight, kind="stable")[:most]
    return np.sort(visible[best])


def orbit(folder: Path) -> dict[str, Any]:
    """Where a viewer looks: the point that all cameras look at, and the first held-out camera."""
    scene = Scene.load(folder)
    views = scene.registered("test") + scene.registered("train")
    cameras = [view.camera for view in views if view.camera is not None]
    if not cameras:
        raise InputError(f"{folder}: expected registered views, found none")
    centres = np.stack([camera.centre for camera in cameras])
    axes = np.stack([camera.rotation[2] for camera in cameras])
    ups = -np.stack([camera.rotation[1] for camera in cameras]).mean(axis=0)
    inner = cameras[0].intrinsics
    return {
        "target": _rounded(nearest_point(centres, axes)),
        "eye": _rounded(centres[0]),
        "up": _rounded(ups / np.linalg.norm(ups)),
        "fov": round(float(2 * np.arctan(inner.height / 2 / inner.fy)), 5),
    }


def nearest_point(centres: Floats, axes: Floats) -> Floats:
    """Return the point nearest to all rays ``centres`` [N, 3] + t · unit ``axes`` [N, 3]."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # [N, 3, 3]: removes the part along
    matrix, side = across.sum(axis=0), (across @ centres[:, :, None]).sum(axis=0)[:, 0]
    if np.linalg.cond(matrix) > 1e6:  # parallel rays meet nowhere: look one unit ahead
        ahead: Floats = centres.mean(axis=0) + axes.mean(axis=0)
        return ahead
    solved: Floats = np.linalg.solve(matrix, side)
    return solved


def _levels(values: Floats, low: Any, high: Any, top: int) -> Floats:
    span = np.maximum(np.asarray(high) - np.asarray(low), 1e-12)
    levels: Floats = np.rint((values - low) / span * top)
    return levels


def _turns(quaternions: Floats) -> NDArray[np.int8]:
    unit = quaternions / np.maximum(np.linalg.norm(quaternions, axis=1, keepdims=True), 1e-12)
    upright = unit * np.where(unit[:, :1] < 0, -1, 1)
    turns: NDArray[np.int8] = np.rint(upright[:, 1:] * 127).astype(np.int8)
    return turns


def _rounded(vector: Floats) -> list[float]:
    return [round(float(value), 6) for value in vector]
