"""SIFT key points of whole photos, each marked as inside or outside the object's mask.

SIFT (Lowe 2004) always sees the whole photo: a mask filters key points after detection, so that the
mask's own edge never becomes a key point. One detection therefore serves every mode, and says how
many key points masking saves. Two implementations, with the same settings: OpenCV's is several
times faster, as only key points that are matched are described; COLMAP's finds some more of them
again in other photos, which is what captures with little texture need. Runs in the worker process.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import disc, read_map
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError
from mattgs_ops.sfm.colmap.job import JobView

# One step of the ladder for textureless objects: COLMAP's peak threshold (0.02 / 3) divided by 4
# finds the faint blobs that the default leaves out.
FAINT = 0.25
# … and the mask grown by this share of the longest side, for features on the object's outline.
GROWTH = 0.02
# COLMAP registers an image on 30 inliers; twice as many key points are the least to hope for.
FEW_KEYPOINTS = 60
ENOUGH_VIEWS = 0.9  # the ladder is climbed until this share of views has more than that
LAYERS = 3  # per octave, as Lowe and COLMAP have it; OpenCV divides its threshold by them
# At this share of COLMAP's threshold OpenCV finds about as many key points: 5 % fewer on renders
# (rover), 13 % more on photos (fox); those of largest scale are used
SAME_PEAKS = 0.75
COLMAP_MOST = 32_768  # key points that COLMAP's SIFT returns; the choice among them is ours

Pair = tuple[int, int]  # of views, by their places
Matches = NDArray[np.uint32]  # [M, 2] rows of the two views' key points


@dataclass(frozen=True)
class Features:
    """Key points of one photo, largest scale first.

    ``keypoints`` [K, 4] float32: x, y, scale, orientation in pixels of the photo; ``descriptors``
    [K, 128] uint8 of length 512; ``inside`` [K] bool: on the object. ``whole`` and ``masked`` [K]
    bool are the two sets that are matched, of the photo and of the object alone; ``found`` counts
    the key points before the cap, in the photo and on the object.
    """

    keypoints: NDArray[np.float32]
    descriptors: NDArray[np.uint8]
    inside: NDArray[np.bool_]
    whole: NDArray[np.bool_]
    masked: NDArray[np.bool_]
    found: tuple[int, int]

    @property
    def positions(self) -> NDArray[np.float64]:
        """Pixels of the key points, [K, 2]."""
        return self.keypoints[:, :2].astype(np.float64)

    def rows_of_mode(self, mode: str) -> NDArray[np.int64]:
        """Return the rows of those key points, sorted."""
        keep = {"original": self.whole, "masked": self.masked}.get(mode, self.whole | self.masked)
        return np.flatnonzero(keep)

    def of_mode(self, mode: str) -> "Features":
        """Return the key points that a mode may use: ``original``, ``masked``, or ``shared``."""
        keep = self.rows_of_mode(mode)
        return Features(
            self.keypoints[keep],
            self.descriptors[keep],
            self.inside[keep],
            self.whole[keep],
            self.masked[keep],
            self.found,
        )


@dataclass(frozen=True)
class Extraction:
    """How key points are sought.

    ``peak_threshold`` is SIFT's, ``grow_share`` the growth of masks as a share of the longest side,
    ``thorough`` whether COLMAP's SIFT of affine shapes finds them instead of OpenCV's.
    """

    peak_threshold: float
    grow_share: float = 0.0
    thorough: bool = False


def ladder(config: SfmConfig, *, thorough: bool = False) -> list[tuple[str | None, Extraction]]:
    """Return the extractions to try in order, each with the note on why it is needed."""
    usual, faint = config.peak_threshold, config.peak_threshold * FAINT
    return [
        (None, Extraction(usual, 0.0, thorough)),
        (
            f"SIFT peak threshold lowered from {usual:.4f} to {faint:.4f}",
            Extraction(faint, 0.0, thorough),
        ),
        (
            f"masks grown by {GROWTH:.0%} of the longest side for finding key points",
            Extraction(faint, GROWTH, thorough),
        ),
    ]


def enough(features: list[Features]) -> bool:
    """Say whether enough views have enough key points inside their masks."""
    counts = [f.found[1] for f in features]
    return sum(c >= FEW_KEYPOINTS for c in counts) >= ENOUGH_VIEWS * len(counts)


def extract(
    views: tuple[JobView, ...],
    config: SfmConfig,
    how: Extraction,
    threads: int,
    progress: Callable[[int, int, str], None],
) -> list[Features]:
    """Extract every view's key points; the same bits for any number of threads."""
    cv2.setNumThreads(1)  # one photo per thread: OpenCV's own threads would change the order

    def one(view: JobView) -> Features:
        if how.thorough:
            return describe_by_colmap(view, config, how)
        longest = config.max_image_size
        if not config.upsample:
            longest = min(longest, max(view.width, view.height) // 2)  # what OpenCV doubles
        grey, scale = read_grey(Path(view.photo), longest)
        return describe(grey, scale, Path(view.mask), config.max_features, how)

    out: list[Features] = []
    with ThreadPoolExecutor(threads) as pool:
        for view, features in zip(views, pool.map(one, views), strict=True):
            out.append(features)
            progress(len(out), len(views), f"{features.found[0]} key points in {view.name}")
    return out


def describe(
    grey: NDArray[np.uint8], scale: tuple[float, float], mask: Path, limit: int, how: Extraction
) -> Features:
    """Find the key points of a photo [H, W], choose, and describe the chosen ones alone.

    ``scale`` (x, y) turns pixels of ``grey`` into pixels of the photo and of its ``mask``.
    """
    sift = cv2.SIFT.create(
        nOctaveLayers=LAYERS,
        contrastThreshold=LAYERS * SAME_PEAKS * how.peak_threshold,
        enable_precise_upscale=True,
    )
    detected = sift.detect(grey, None)
    rows = [(*k.pt, k.size / 2, np.radians(k.angle)) for k in detected]  # OpenCV: diameter, degrees
    keypoints = np.array(rows, dtype=np.float32).reshape(-1, 4)
    keypoints[:, :2] += 0.5  # OpenCV's pixels have their centre at 0
    keypoints[:, :3] *= (*scale, scale[0])
    inside = inside_mask(mask, keypoints, how.grow_share)
    chosen = select(keypoints, inside, limit)
    _, raw = sift.compute(grey, [detected[row] for row in chosen.rows])
    return Features(
        keypoints[chosen.rows],
        root_sift(np.zeros((0, 128), np.float32) if raw is None else raw),
        inside[chosen.rows],
        chosen.whole,
        chosen.masked,
        (len(inside), int(inside.sum())),
    )


def describe_by_colmap(view: JobView, config: SfmConfig, how: Extraction) -> Features:
    """Find and describe all key points of a photo by COLMAP's SIFT, then choose.

    Each is described in an ellipse that its surroundings give (Mikolajczyk and Schmid, Scale and
    affine invariant interest point detectors, IJCV 2004), so that surfaces seen from 60° aside
    still match; COLMAP's FAQ advises it where photos match badly.
    """
    import pycolmap

    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.num_threads = 1
    options.sift.max_num_features = COLMAP_MOST
    options.sift.first_octave = -1 if config.upsample else 0
    options.sift.peak_threshold = how.peak_threshold
    options.sift.estimate_affine_shape = True
    # an extractor keeps state between calls and is not shared between threads
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    grey, scale = read_grey(Path(view.photo), config.max_image_size)
    detected, described = extractor.extract(pycolmap.Bitmap.from_array(grey))
    keypoints = pycolmap.keypoints_to_matrix(detected).astype(np.float32).reshape(-1, 4)
    keypoints[:, :3] *= (*scale, scale[0])
    inside = inside_mask(Path(view.mask), keypoints, how.grow_share)
    chosen = select(keypoints, inside, config.max_features)
    return Features(
        keypoints[chosen.rows],
        np.asarray(described.data, dtype=np.uint8).reshape(-1, 128)[chosen.rows],
        inside[chosen.rows],
        chosen.whole,
        chosen.masked,
        (len(inside), int(inside.sum())),
    )


def root_sift(raw: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the square roots of descriptors [K, 128], of length 512 (Arandjelović 2012)."""
    share = raw / np.maximum(raw.sum(axis=1, keepdims=True), 1)
    return np.asarray(np.minimum(np.rint(512 * np.sqrt(share)), 255), dtype=np.uint8)


@dataclass(frozen=True)
class Choice:
    """Key points that are kept: ``rows`` [K] of all, and which of them are in the two sets."""

    rows: NDArray[np.int64]
    whole: NDArray[np.bool_]
    masked: NDArray[np.bool_]


def select(keypoints: NDArray[np.float32], inside: NDArray[np.bool_], limit: int) -> Choice:
    """Keep the ``limit`` key points [N, 4] of largest scale of the photo, and of the object.

    Large scales are the ones that repeat between views (COLMAP caps in that order as well).
    """
    order = np.argsort(-keypoints[:, 2], kind="stable")
    on_object = inside[order]
    whole = np.arange(len(order)) < limit
    masked = on_object & (np.cumsum(on_object) <= limit)
    kept = whole | masked
    return Choice(order[kept], whole[kept], masked[kept])


def read_grey(path: Path, longest: int) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """Read a photo as grey, no side longer than ``longest``; also return photo size / its size.

    The latter in x and in y: each side of what is read is a whole number of pixels.
    """
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise InputError(f"{path}: expected a readable photo")
    height, width = grey.shape
    if max(height, width) <= longest:
        return np.asarray(grey, dtype=np.uint8), (1.0, 1.0)
    scale = max(height, width) / longest
    size = (max(1, round(width / scale)), max(1, round(height / scale)))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8), (width / size[0], height / size[1])


def inside_mask(path: Path, keypoints: NDArray[np.float32], grow: float) -> NDArray[np.bool_]:
    """Say which key points [K, 4] fall on the mask, grown by ``grow`` of its longest side."""
    mask = read_map(path)
    height, width = mask.shape
    if grow:
        radius = max(1, round(grow * max(height, width)))
        mask = np.asarray(cv2.dilate(mask, disc(radius)), dtype=np.uint8)
    x = np.clip(keypoints[:, 0].astype(np.int64), 0, width - 1)
    y = np.clip(keypoints[:, 1].astype(np.int64), 0, height - 1)
    return np.asarray(mask[y, x] > 0)
