"""A quick look at photos before anything long is started: what is wrong, and what it may lead to.

``inspect(capture)`` takes a prepared capture and says of each photo how sharp and how bright it is,
and to how many others it can be matched. Photos that hang together by matches are what
structure-from-motion can place. All is done at :data:`SIDE` pixels: a share of a second a photo.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mattgs_ops.capture.photos import read_rgb
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.capture.video import sharpness
from mattgs_ops.progress import Progress, no_progress

SIDE = 480  # pixels of the longest side at which photos are matched
FEATURES = 1500  # SIFT key points a photo
RATIO = 0.8  # Lowe 2004: nearest against second nearest
FEWEST_INLIERS = 15  # COLMAP's own, of two views' geometry
LOOSE = 2.0  # pixels from an epipolar line, at SIDE; what moves less is in the same place
AROUND = 4  # neighbours by name that a photo is matched with, to either side
STRIDE = 7  # and every so-many-th photo beyond them: walks go around more than once
BLURRED = 0.25  # of the median sharpness: the motion of a hand, not another distance
DARK, BRIGHT = 0.08, 0.92  # mean of a photo, of 1: little is left to match
UNEVEN = 0.25  # standard deviation of the photos' log2 brightness: a quarter of a stop
FEW_PHOTOS = 12  # neighbours farther apart than 30 degrees are hardly matched by SIFT
SEED = 0

STANDS_STILL = (
    "most photos show the same things in the same places: the camera stands still, and poses will "
    "come from the object alone; take photos at every 10 degrees or less, or walk around it"
)

Grey = NDArray[np.uint8]


@dataclass(frozen=True)
class Inspected:
    """What was seen: a number per photo, and sentences about what is wrong."""

    names: tuple[str, ...]
    sharpness: tuple[float, ...]
    brightness: tuple[float, ...]  # 0 to 1
    matched: tuple[int, ...]  # photos that share FEWEST_INLIERS matches with this one
    placed: int  # photos that hang together: about as many will register
    problems: tuple[str, ...]


def inspect(capture: PreparedCapture, *, progress: Progress = no_progress) -> Inspected:
    """Look at all photos of a capture; ``progress`` counts each photo once."""
    names = tuple(view.name for view in capture.views)
    sharp, bright, features = [], [], []
    sift = cv2.SIFT.create(nfeatures=FEATURES)
    for index, view in enumerate(capture.views):
        photo = read_rgb(view.photo)
        grey = _shrunk(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY))
        sharp.append(sharpness(np.ascontiguousarray(photo[..., ::-1])))
        bright.append(float(grey.mean()) / 255)
        features.append(sift.detectAndCompute(grey, None))
        progress(index + 1, len(names), view.name)
    if capture.cameras_are == "given":
        matched, placed, still = [len(names) - 1] * len(names), len(names), False
    else:
        matched, placed, still = _matches(features)
    problems = _problems(names, sharp, bright, matched, placed)
    problems += [STANDS_STILL] if still else []
    return Inspected(names, tuple(sharp), tuple(bright), tuple(matched), placed, tuple(problems))


def pairs(count: int) -> list[tuple[int, int]]:
    """Return the pairs of photos to match: neighbours by name, and some beyond, each once."""
    steps = [*range(1, AROUND + 1), *range(AROUND + STRIDE, count, STRIDE)]
    found = {tuple(sorted((i, (i + step) % count))) for i in range(count) for step in steps}
    return sorted((a, b) for a, b in found if a != b)


def _matches(
    features: Sequence[tuple[Sequence[cv2.KeyPoint], Grey | None]],
) -> tuple[list[int], int, bool]:
    """Return with how many others each photo matches, and the size of the largest group.

    And whether the camera stands still: in more than half of the pairs that match, more than half
    of the matches have not moved.
    """
    count = len(features)
    moved = {pair: _moved(features[pair[0]], features[pair[1]]) for pair in pairs(count)}
    linked = [pair for pair, by in moved.items() if by is not None]
    still = sum(by is not None and by < LOOSE for by in moved.values()) > len(linked) / 2
    matched = np.bincount(np.array(linked, dtype=np.int64).ravel(), minlength=count)
    first, second = np.array(linked, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    groups = connected_components(graph, directed=False)[1]
    return [int(one) for one in matched], int(np.bincount(groups).max()), still


def _moved(
    first: tuple[Sequence[cv2.KeyPoint], Grey | None],
    second: tuple[Sequence[cv2.KeyPoint], Grey | None],
) -> float | None:
    """Return by how many pixels the matches that lie on epipolar lines moved, the median of them.

    None where two photos share too few.
    """
    if first[1] is None or second[1] is None or min(len(first[1]), len(second[1])) < FEWEST_INLIERS:
        return None
    found = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first[1], second[1], k=2)
    good = [two[0] for two in found if len(two) == 2 and two[0].distance < RATIO * two[1].distance]
    if len(good) < FEWEST_INLIERS:
        return None
    here = np.array([first[0][one.queryIdx].pt for one in good], dtype=np.float32)
    there = np.array([second[0][one.trainIdx].pt for one in good], dtype=np.float32)
    cv2.setRNGSeed(SEED)
    inliers = cv2.findFundamentalMat(here, there, cv2.FM_RANSAC, LOOSE, 0.99)[1]
    if inliers is None or int(inliers.sum()) < FEWEST_INLIERS:
        return None
    on_lines = inliers.ravel() > 0
    return float(np.median(np.linalg.norm(here[on_lines] - there[on_lines], axis=1)))


def _problems(
    names: Sequence[str],
    sharp: Sequence[float],
    bright: Sequence[float],
    matched: Sequence[int],
    placed: int,
) -> list[str]:
    """Say what is wrong, one sentence each."""
    usual = float(np.median(sharp))
    listed = {
        "blurred (next to the others)": [
            n for n, s in zip(names, sharp, strict=True) if s < BLURRED * usual
        ],
        "too dark": [n for n, b in zip(names, bright, strict=True) if b < DARK],
        "too bright": [n for n, b in zip(names, bright, strict=True) if b > BRIGHT],
        "not matched with any other photo": [
            n for n, m in zip(names, matched, strict=True) if m == 0
        ],
    }
    problems = [
        f"{len(found)} {what}: {', '.join(found)}" for what, found in listed.items() if found
    ]
    spread = float(np.log2(np.maximum(bright, 1 / 255)).std())
    if spread > UNEVEN:
        problems.append(f"exposure differs between photos: {spread:.2f} stops (standard deviation)")
    if len(names) < FEW_PHOTOS:
        problems.append(
            f"{len(names)} photos are few: from {FEW_PHOTOS} on they overlap, 30 are better"
        )
    if placed < len(names):
        problems.append(f"about {placed} of {len(names)} photos hang together by matches")
    return problems


def _shrunk(grey: Grey) -> Grey:
    factor = min(1.0, SIDE / max(grey.shape))
    size = (max(1, round(grey.shape[1] * factor)), max(1, round(grey.shape[0] * factor)))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
