"""What the other views' maps predict of each view, by outlines alone: no texture, no splats.

A point of the object lies inside every silhouette (Laurentini 1994). For each ray of a view the
largest share of the *other* views that call one of its points object is what they predict there:
1 where a point is in all their silhouettes, small where none is in many. Where the maps are right,
the prediction covers the view's own map, on black cloth as well as on a desk; where maps leak or
miss, each elsewhere, it does not. How well it meets the view's own map is the maps' **agreement**.

Maps of which views are wrong is not known, so that a share below 1 may be object: the share from
which on a ray counts is the one of :data:`SHARES` with the best agreement.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, in_frame
from mattgs_ops.capture.masks import HALF, SoftMap

SIDE = 128  # pixels of the longest side at which silhouettes are compared: maps are coarse
GRID = 80  # points along each axis of the cube around the object
MARGIN = 1.3  # of the object's radius: the cube holds a little more than the median silhouette
FEWEST_SHARE = 0.5  # of the other views must see a point for it to count
SHARES = (1.0, 0.9, 0.75, 0.5)  # from none of the maps wrong to half of them
CONTRADICT = 0.5  # IoU below which two masks differ in more than they share
FEWEST_VIEWS = 2
NEAREST = 0.1  # of the points are nearer to the camera than those whose gaps are closed
MOST_GAP = 8  # pixels; a camera that is closer sees nothing else
LARGEST_CONDITION = 1e6  # of the rays' equations: beyond it all views look the same way

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Silhouettes:
    """``predicted`` [V][H, W] in [0, 1], at least 0.5 where the other views say object.

    ``agreement`` is the IoU of prediction and own map of each view that found something; ``share``
    is the share of the other views from which on a ray counts.
    """

    predicted: list[SoftMap]
    agreement: list[float]
    share: float

    @property
    def mean(self) -> float:
        """Mean agreement of the views that found something."""
        return float(np.mean(self.agreement))


def seen_within(cameras: Sequence[Camera], middle: Floats) -> float:
    """Return the largest angle in degrees between the ways from ``middle`` [3] to two cameras."""
    ways = np.stack([camera.centre for camera in cameras]) - middle
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip(ways @ ways.T, -1, 1).min())))


def predict(
    cameras: Sequence[Camera], maps: Sequence[SoftMap], trained: Sequence[bool] | None = None
) -> Silhouettes | None:
    """Predict every view's map from the others'; ``maps`` [H, W] in [0, 1] fit their cameras.

    Views whose map shows nothing are predicted, and predict nothing; so are those that are not
    ``trained`` on (None: all are). None where fewer than two maps show something, or the rays
    through their middles meet nowhere.
    """
    own = [soft >= HALF for soft in maps]
    counted = [
        bool(mask.any()) and use
        for mask, use in zip(own, trained or [True] * len(own), strict=True)
    ]
    points = _points(cameras, own, counted)
    if points is None:
        return None
    places = [_pixels(camera, points) for camera in cameras]
    seen, covered = np.zeros(len(points), np.int32), np.zeros(len(points), np.int32)
    for mask, (index, inside), counts in zip(own, places, counted, strict=True):
        if counts:
            seen += inside
            covered += inside & mask.ravel()[index]
    shares, unwatched = [], []
    gaps = [_gap(camera, points) for camera in cameras]
    for mask, (index, inside), counts, gap in zip(own, places, counted, gaps, strict=True):
        others = seen - inside if counts else seen
        yes = covered - (inside & mask.ravel()[index]) if counts else covered
        enough = (others >= FEWEST_SHARE * (sum(counted) - counts)) & (others > 0)
        share = (yes / np.where(enough, others, 1) * (inside & enough)).astype(np.float32)
        shares.append(_largest(share, index, mask.shape, gap))
        unseen = (inside & ~enough).astype(np.float32)
        unwatched.append(_largest(unseen, index, mask.shape, gap) > 0)
    found = _fitted(shares, own, counted)
    # where few others look, they take nothing away: the view's own map stays
    predicted = [
        np.where(unseen, np.maximum(soft, mask), soft)
        for soft, mask, unseen in zip(found.predicted, own, unwatched, strict=True)
    ]
    return replace(found, predicted=predicted)


def iou(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Return intersection over union of two masks [H, W]; 1 where both are empty."""
    union = int((first | second).sum())
    return int((first & second).sum()) / union if union else 1.0


def overlaps(first: Sequence[SoftMap], second: Sequence[SoftMap]) -> list[float]:
    """Return the IoU of each two maps [H, W], 0.5 and above is object."""
    return [iou(a >= HALF, b >= HALF) for a, b in zip(first, second, strict=True)]


def resized(maps: Sequence[SoftMap], like: Sequence[SoftMap]) -> list[SoftMap]:
    """Return each map [H, W] at the size of another."""
    return [
        np.asarray(cv2.resize(soft, one.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        for soft, one in zip(maps, like, strict=True)
    ]


def around_half(share: SoftMap, wanted: float) -> SoftMap:
    """Stretch shares or votes [H, W] so that the wanted one becomes a half, and 0 and 1 stay."""
    above = np.ones_like(share) if wanted >= 1 else 0.5 + 0.5 * (share - wanted) / (1 - wanted)
    stretched: SoftMap = np.where(share < wanted, share / (2 * wanted), above).astype(np.float32)
    return stretched


def _fitted(
    shares: Sequence[SoftMap], own: Sequence[NDArray[np.bool_]], counted: Sequence[bool]
) -> Silhouettes:
    """Choose the share that meets the views' own maps best."""
    tried: dict[float, list[float]] = {
        wanted: [
            iou(share >= wanted, mask)
            for share, mask, counts in zip(shares, own, counted, strict=True)
            if counts
        ]
        for wanted in SHARES
    }
    best = float(SHARES[int(np.argmax([np.mean(tried[wanted]) for wanted in SHARES]))])
    return Silhouettes([around_half(share, best) for share in shares], tried[best], best)


def _points(
    cameras: Sequence[Camera], own: Sequence[NDArray[np.bool_]], counted: Sequence[bool]
) -> Floats | None:
    """Fill the ball around the object with points [P, 3], by the maps' middles and extents."""
    rays, normal, offset = [], np.zeros((3, 3)), np.zeros(3)
    for camera, mask, counts in zip(cameras, own, counted, strict=True):
        if not counts:
            continue
        rows, columns = np.nonzero(mask)
        lens = camera.intrinsics
        x, y = columns.mean() + 0.5, rows.mean() + 0.5
        way = camera.rotation.T @ [(x - lens.cx) / lens.fx, (y - lens.cy) / lens.fy, 1.0]
        across = np.eye(3) - np.outer(way, way) / (way @ way)
        normal += across
        offset += across @ camera.centre
        extent = np.hypot(columns + 0.5 - x, rows + 0.5 - y).max() / lens.fx
        rays.append((camera, float(extent)))
    if len(rays) < FEWEST_VIEWS or np.linalg.cond(normal) > LARGEST_CONDITION:
        return None
    middle = np.asarray(np.linalg.solve(normal, offset), dtype=np.float64)
    radii = [extent * float(camera.depths(middle[None])[0]) for camera, extent in rays]
    radius = MARGIN * float(np.median(radii))
    if radius <= 0:
        return None
    steps = (np.arange(GRID) + 0.5) / GRID * 2 - 1
    cube = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    ball: Floats = cube[np.linalg.norm(cube, axis=1) <= 1] * radius + middle
    return ball


def _pixels(camera: Camera, points: Floats) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return each point's pixel as an index into the flat image [P], and whether it is inside."""
    size = camera.intrinsics
    places, depths = camera.project(points)
    inside = in_frame(places, depths, (size.width, size.height))
    columns, rows = (np.where(inside, one, 0).astype(np.int64) for one in places.T)
    return rows * size.width + columns, inside


def _gap(camera: Camera, points: Floats) -> int:
    """Return how many pixels lie between neighbouring points as a camera sees the nearest ones."""
    depths = camera.depths(points)
    nearest = float(np.quantile(depths[depths > 0], NEAREST)) if (depths > 0).any() else 1.0
    pitch = float(np.ptp(points[:, 0])) / GRID
    return min(MOST_GAP, max(1, int(np.ceil(pitch * camera.intrinsics.fx / nearest))))


def _largest(share: SoftMap, index: NDArray[np.int64], shape: tuple[int, ...], gap: int) -> SoftMap:
    """Return the largest share along each pixel's ray [H, W]; gaps between points are closed."""
    image = np.zeros(shape, np.float32)
    np.maximum.at(image.reshape(-1), index, share)
    side = 2 * gap + 1
    grown = cv2.dilate(image, np.ones((side, side), np.uint8))
    if gap == 1:
        return np.asarray(grown, dtype=np.float32)
    closed: SoftMap = cv2.erode(grown, np.ones((side - 2, side - 2), np.uint8))
    return closed
