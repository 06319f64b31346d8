"""Agreement between views: saliency maps of one object vote for a shape in space.

A single photo's map may leak into the clutter or miss a part; photos from all around rarely do so
in the same place. Each voxel of a grid around the object asks every view that sees it how much
object lies there, and keeps the answer that all but a quarter of them reach or exceed: a visual
hull (Laurentini 1994) that forgives single views. Seen again from each camera it is a map that
agrees with the others, blended with the photo's own, which knows the outline better.

Needs a camera for each view: given with the capture, or found by SfM on whole photos.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.camera import Array, Camera
from mattgs_ops.errors import StageError
from mattgs_ops.masks import SoftMap

GRID = 80  # voxels along each side
WORKING_SIDE = 160  # pixels of the longest side at which maps are compared
DISSENT = 0.25  # share of the views that may say "background" of a voxel that is kept
SEEN_BY = 0.5  # share of the views that must have a voxel in their frame
MARGIN = 1.6  # of the object's apparent radius, for the grid's half side
HULL_SHARE = 0.6  # weight of the hull against the photo's own map
REACH = 0.05  # how far beyond the hull a part may stick out that most views missed
FEWEST_VIEWS = 4


def agree(maps: Sequence[SoftMap], cameras: Sequence[Camera]) -> list[SoftMap]:
    """Blend each map [H, W] in 0..1 with what the other views say; same sizes come back.

    Raises :class:`StageError` for fewer than four views, or views that share no object.
    """
    found = hulls([shrunk(soft) for soft in maps], cameras)
    return [blend(soft, hull) for soft, hull in zip(maps, found, strict=True)]


def hulls(maps: Sequence[SoftMap], cameras: Sequence[Camera]) -> list[SoftMap]:
    """Return, for each small map, the common shape as its camera sees it; same sizes.

    Raises :class:`StageError` as ``agree`` does.
    """
    if len(maps) < FEWEST_VIEWS:
        raise StageError(f"votes: expected at least {FEWEST_VIEWS} views, found {len(maps)}")
    scaled = [
        camera.scaled(soft.shape[1], soft.shape[0])
        for camera, soft in zip(cameras, maps, strict=True)
    ]
    centre, radius = locate(maps, scaled)
    voxels = _grid(centre, MARGIN * radius)
    votes = poll(voxels, maps, scaled)
    if votes.max() < 0.5:
        raise StageError("votes: the views' maps agree on no object; keep `refine` without votes")
    kept = votes > 0.1  # fainter voxels change nothing
    step = 2 * MARGIN * radius / GRID
    return [splat(voxels[kept], votes[kept], camera, step) for camera in scaled]


def blend(soft: SoftMap, hull: SoftMap) -> SoftMap:
    """Mix a photo's own map [H, W] with the hull [h, w] seen from its camera.

    Well outside the hull (``REACH`` of the longest side) the photo's own map has no say.
    """
    side = 2 * max(1, round(REACH * max(hull.shape))) + 1
    around = cv2.dilate(hull, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    size = (soft.shape[1], soft.shape[0])
    near = cv2.resize(around, size, interpolation=cv2.INTER_LINEAR) > 0.1
    resized = cv2.resize(hull, size, interpolation=cv2.INTER_LINEAR)
    mixed = HULL_SHARE * resized + (1 - HULL_SHARE) * np.where(near, soft, 0)
    return np.asarray(mixed, dtype=np.float32)


def locate(maps: Sequence[SoftMap], cameras: Sequence[Camera]) -> tuple[Array, float]:
    """Return the object's centre [3] and apparent radius, from the maps' centroids and spreads.

    The centre is the point nearest to the rays through the centroids, rays that pass far from it
    counting less (iteratively reweighted least squares).
    """
    rays, spreads = [], []
    for soft, camera in zip(maps, cameras, strict=True):
        ys, xs = np.nonzero(soft > 0.5)
        if len(xs) == 0:
            continue
        k = camera.intrinsics
        x, y = (xs.mean() + 0.5 - k.cx) / k.fx, (ys.mean() + 0.5 - k.cy) / k.fy
        ray = camera.rotation.T @ np.array([x, y, 1.0])
        rays.append((camera.centre, ray / np.linalg.norm(ray)))
        spreads.append(np.sqrt(2) * np.hypot(xs.std() / k.fx, ys.std() / k.fy))
    if len(rays) < FEWEST_VIEWS:
        raise StageError(f"votes: expected an object in four views or more, found {len(rays)}")
    origins = np.array([origin for origin, _ in rays])
    directions = np.array([direction for _, direction in rays])
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weights, centre = np.ones(len(rays)), np.zeros(3)
    for _ in range(10):
        matrix = (weights[:, None, None] * across).sum(0)
        target = (weights[:, None, None] * across @ origins[:, :, None]).sum(0)[:, 0]
        centre = np.linalg.solve(matrix, target)
        misses = np.linalg.norm((across @ (centre - origins)[:, :, None])[..., 0], axis=1)
        weights = 1 / np.maximum(misses, 1e-3 * np.median(misses) + 1e-12)
    depths = np.linalg.norm(centre - origins, axis=1)
    return centre, float(np.median(depths * np.array(spreads)))


def poll(voxels: Array, maps: Sequence[SoftMap], cameras: Sequence[Camera]) -> NDArray[np.float32]:
    """Voxels [N, 3] to votes [N]: the ``DISSENT`` quantile over the views that see each."""
    answers = np.full((len(maps), len(voxels)), np.nan, np.float32)
    for row, soft, camera in zip(answers, maps, cameras, strict=True):
        pixels, depth = camera.project(voxels)
        height, width = soft.shape
        x, y = np.floor(pixels[:, 0]), np.floor(pixels[:, 1])
        seen = (depth > 0) & (x >= 0) & (y >= 0) & (x < width) & (y < height)
        row[seen] = soft[y[seen].astype(int), x[seen].astype(int)]
    known = np.isfinite(answers).sum(0)
    order = np.sort(answers, axis=0)  # nan last
    rank = np.minimum((DISSENT * known).astype(int), len(maps) - 1)
    votes = order[rank, np.arange(len(voxels))]
    votes[known < max(SEEN_BY * len(maps), FEWEST_VIEWS)] = 0
    return np.asarray(np.nan_to_num(votes), dtype=np.float32)


def splat(voxels: Array, votes: NDArray[np.float32], camera: Camera, step: float) -> SoftMap:
    """Draw voxels of side ``step`` as a camera sees them: the largest vote per pixel, [H, W]."""
    k = camera.intrinsics
    shown = np.zeros((k.height, k.width), np.float32)
    pixels, depth = camera.project(voxels)
    x, y = np.floor(pixels[:, 0]), np.floor(pixels[:, 1])
    seen = (depth > 0) & (x >= 0) & (y >= 0) & (x < k.width) & (y < k.height)
    np.maximum.at(shown, (y[seen].astype(int), x[seen].astype(int)), votes[seen])
    if seen.any():
        footprint = k.fx * step / float(np.median(depth[seen]))
        side = max(1, 2 * int(np.ceil(footprint / 2)) + 1)
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        shown = cv2.morphologyEx(shown, cv2.MORPH_CLOSE, kernel)
    return np.asarray(cv2.GaussianBlur(shown, (0, 0), 0.7), dtype=np.float32)


def _grid(centre: Array, half: float) -> Array:
    axis = ((np.arange(GRID) + 0.5) / GRID * 2 - 1) * half
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3) + centre


def shrunk(soft: SoftMap) -> SoftMap:
    """Return a map with its longest side at most ``WORKING_SIDE``."""
    factor = min(1.0, WORKING_SIDE / max(soft.shape))
    size = (max(1, round(soft.shape[1] * factor)), max(1, round(soft.shape[0] * factor)))
    return np.asarray(cv2.resize(soft, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
