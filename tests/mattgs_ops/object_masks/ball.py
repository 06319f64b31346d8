"""A ball above the origin and cameras around it, as ``test_*`` of this folder look at it."""

import numpy as np

from mattgs_ops.capture.camera import Camera, Intrinsics

WIDTH, HEIGHT, VIEWS = 96, 72, 10
RADIUS, CENTRE = 0.6, np.array([0.0, 0.0, 0.6])


def orbit() -> list[Camera]:
    lens = Intrinsics(WIDTH, HEIGHT, 90.0, 90.0, WIDTH / 2, HEIGHT / 2)
    cameras = []
    for k in range(VIEWS):
        angle, rise = 2 * np.pi * k / VIEWS, 0.45 if k % 2 else 0.8
        away = np.array([np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)])
        eye = CENTRE + 3.2 * away
        right = np.cross(-away, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(-away, right), -away])
        cameras.append(Camera(lens, rotation, -rotation @ eye))
    return cameras


def truth(camera: Camera) -> np.ndarray:
    """Return the ball's silhouette [H, W] in {0, 1}."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    k = camera.intrinsics
    rays = np.stack([(x - k.cx) / k.fx, (y - k.cy) / k.fy, np.ones_like(x)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    middle = camera.rotation @ CENTRE + camera.translation
    return (np.linalg.norm(np.cross(rays, middle), axis=-1) < RADIUS).astype(np.float32)


def leaking(maps: list[np.ndarray]) -> list[np.ndarray]:
    """Return copies of maps [H, W] that leak beside the ball, elsewhere in every view."""
    leaked = [soft.copy() for soft in maps]
    for index, soft in enumerate(leaked):
        soft[8 + index : 40 + index, slice(0, 30) if index % 2 else slice(-30, None)] = 1
    return leaked


def notched(maps: list[np.ndarray]) -> list[np.ndarray]:
    """Return copies of the views' maps that lack another part of the ball's right side in each."""
    copies = [soft.copy() for soft in maps]
    for index, soft in enumerate(copies):
        soft[24 + 2 * index :][:8, 52:] = 0
    return copies
