"""Agreement between views: what most see survives, what one view invents does not."""

import numpy as np
import pytest

from mattgs_ops.camera import Camera, Intrinsics
from mattgs_ops.errors import StageError
from mattgs_ops.masks import quality
from mattgs_ops.segment.votes import agree, locate

RADIUS, CENTRE = 0.5, np.array([0.2, -0.1, 0.3])
PINHOLE = Intrinsics(96, 72, 90.0, 90.0, 48.0, 36.0)


def orbit(count: int) -> list[Camera]:
    cameras = []
    for i in range(count):
        angle, rise = 2 * np.pi * i / count, 0.5 if i % 2 else 0.9
        away = np.array([np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)])
        eye = CENTRE + 3 * away
        right = np.cross(-away, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(-away, right), -away])
        cameras.append(Camera(PINHOLE, rotation, -rotation @ eye))
    return cameras


def sphere(camera: Camera) -> np.ndarray:
    k = camera.intrinsics
    x, y = np.meshgrid(np.arange(k.width) + 0.5, np.arange(k.height) + 0.5)
    rays = np.stack([(x - k.cx) / k.fx, (y - k.cy) / k.fy, np.ones_like(x)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    middle = camera.rotation @ CENTRE + camera.translation
    miss = np.linalg.norm(np.cross(rays, middle), axis=-1)
    return (miss < RADIUS).astype(np.float32)


def ious(maps: list[np.ndarray], truths: list[np.ndarray]) -> list[float]:
    return [
        quality((m > 0.5).astype(np.uint8) * 255, (t > 0.5).astype(np.uint8) * 255).iou
        for m, t in zip(maps, truths, strict=True)
    ]


def test_leaks_and_losses_of_single_views_are_mended() -> None:
    cameras = orbit(12)
    truths = [sphere(camera) for camera in cameras]
    maps = [0.05 + 0.9 * truth for truth in truths]
    maps[2] = maps[2].copy()
    maps[2][10:30, 5:40] = 0.95  # clutter taken for object
    maps[7] = maps[7].copy()
    maps[7][:, :48] = 0.05  # half of it missed
    before, after = ious(maps, truths), ious(agree(maps, cameras), truths)
    assert min(before[2], before[7]) < 0.65
    assert min(after) > 0.87  # discs of fifteen pixels: one pixel of outline is a tenth


def test_the_object_is_located_despite_an_outlier() -> None:
    cameras = orbit(10)
    maps = [sphere(camera) for camera in cameras]
    maps[4] = np.zeros_like(maps[4])
    maps[4][:12, :12] = 1
    centre, radius = locate(maps, cameras)
    assert np.linalg.norm(centre - CENTRE) < 0.05
    assert radius == pytest.approx(RADIUS, rel=0.25)


def test_too_few_views_and_maps_without_a_common_object_are_refused() -> None:
    cameras = orbit(8)
    maps = [sphere(camera) for camera in cameras]
    with pytest.raises(StageError, match="at least 4 views, found 3"):
        agree(maps[:3], cameras[:3])
    empty = [np.zeros_like(m) for m in maps]
    with pytest.raises(StageError, match="expected an object in four views"):
        agree(empty, cameras)
    scattered = []
    for i, m in enumerate(maps):
        spot = np.zeros_like(m)
        spot[8 * i : 8 * i + 6, 10 * i : 10 * i + 6] = 1
        scattered.append(spot)
    with pytest.raises(StageError, match="agree on no object"):
        agree(scattered, cameras)
