"""A quick look at photos before anything long is started: what is wrong, and what it may lead to.

``inspect(capture)`` takes a prepared capture and says which photos are blurred, too dark or too
bright, and with how many others each can be matched. Photos that hang together by matches are what
structure-from-motion can place. Exposures are compared on matched points, as whole photos show
other things. All is done at :data:`SIDE` pixels: a share of a second a photo.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mattgs_ops.capture.photos import read_rgb
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.capture.video import sharpness
from mattgs_ops.naming import listed_names
from mattgs_ops.progress import Progress, no_progress

SIDE = 480  # pixels of the longest side at which photos are matched
FEATURES = 1500  # SIFT key points a photo
RATIO = 0.8  # Lowe 2004: nearest against second nearest
FEWEST_INLIERS = 15  # COLMAP's own, of two views' geometry
# What COLMAP wants to place one more photo. Where only the object turns, what else moves is matched
# wrongly, and 15 to 20 of such matches lie on some epipolar lines by chance
FEWEST_OF_OBJECT = 30
LOOSE = 2.0  # pixels from an epipolar line, at SIDE; what moves less is in the same place
AROUND = 4  # neighbours by name that a photo is matched with, to either side
STRIDE = 7  # and every so-many-th photo beyond them: walks go around more than once
BLURRED = 0.25  # of the median sharpness: the motion of a hand, not another distance
DARK, BRIGHT = 0.08, 0.92  # mean of a photo, of 1: little is left to match
# unless a hundredth of the pixels, an object's, is on the other side of the middle: white that is
# exposed two stops too short still is, by sRGB's curve
OBJECT_AT_LEAST, MIDDLE = (1, 99), 0.5
UNEVEN = 0.25  # stops, standard deviation over photos: cameras set exposure in thirds of a stop
AROUND_POINT = 4  # pixels, deviation of the blur through which a matched point's light is read
AT_SMALL_ANGLES = "take photos at every 10 degrees or less, or walk around it"
FEW_PHOTOS = 12  # neighbours farther apart than 30 degrees are hardly matched by SIFT
MOST_LISTED = 8  # photos in one sentence
SEED = 0

STANDS_STILL = (
    "most photos show the same things in the same places: the camera stands still, and poses will "
    f"come from the object alone; {AT_SMALL_ANGLES}"
)

Grey = NDArray[np.uint8]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Inspected:
    """What was seen of the photos, and sentences about what is wrong."""

    names: tuple[str, ...]
    matched: tuple[int, ...]  # photos that share FEWEST_INLIERS matches with this one
    placed: int  # photos that hang together: about as many will register
    problems: tuple[str, ...]
    stands_still: bool = False  # the camera, so that only matches on the object count


@dataclass(frozen=True)
class _Features:
    """Key points of a photo, and log2 of the light around them, [N, 2], [N, 128] and [N]."""

    points: NDArray[np.float32]
    descriptors: NDArray[np.float32]
    light: Floats


@dataclass(frozen=True)
class _Matched:
    """Two photos of one scene: how far its points moved between them, and how much lighter it got.

    ``moved`` is in pixels, ``stops`` are exposure values by which the second photo is lighter:
    medians over the matches that lie on epipolar lines. ``moving`` counts the matches that moved
    and lie on epipolar lines of their own: those on the object, where the camera stands still.
    """

    moved: float
    stops: float
    moving: int


def inspect(capture: PreparedCapture, *, progress: Progress = no_progress) -> Inspected:
    """Look at all photos of a capture; ``progress`` counts each photo once."""
    names = tuple(view.name for view in capture.views)
    sharp, light, features = [], [], []
    sift = cv2.SIFT.create(nfeatures=FEATURES)
    for index, view in enumerate(capture.views):
        photo = read_rgb(view.photo)
        grey = _shrunk(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY))
        sharp.append(sharpness(np.ascontiguousarray(photo[..., ::-1])))
        light.append(_light(grey))
        features.append(_features(grey, sift))
        progress(index + 1, len(names), view.name)
    given = capture.cameras_are == "given"
    links = {} if given else _matches(features)
    stands_still = sum(link.moved < LOOSE for link in links.values()) > len(links) / 2
    if given:
        matched, placed = [len(names) - 1] * len(names), len(names)
    else:
        least = FEWEST_OF_OBJECT if stands_still else 0
        linked = [pair for pair, link in links.items() if link.moving >= least]
        matched, placed = _together(linked, len(names))
    problems = _problems(names, sharp, light, matched, placed)
    uneven = float(exposures({pair: link.stops for pair, link in links.items()}, len(names)).std())
    if uneven > UNEVEN:
        problems.append(f"exposure differs between photos: {uneven:.2f} stops (standard deviation)")
    if stands_still:
        problems.append(STANDS_STILL)
    return Inspected(names, tuple(matched), placed, tuple(problems), stands_still)


def pairs(count: int) -> list[tuple[int, int]]:
    """Return the pairs of photos to match: neighbours by name, and some beyond, each once."""
    steps = [*range(1, AROUND + 1), *range(AROUND + STRIDE, count, STRIDE)]
    found = {tuple(sorted((i, (i + step) % count))) for i in range(count) for step in steps}
    return sorted((a, b) for a, b in found if a != b)


def exposures(stops: Mapping[tuple[int, int], float], count: int) -> Floats:
    """Return each photo's exposure in stops [count] from differences between pairs of photos.

    ``stops[a, b]`` is by how much photo ``b`` is lighter than ``a`` where both show the same. Least
    squares; the mean of photos that hang together is 0.
    """
    rows = np.zeros((len(stops), count))
    for row, (first, second) in zip(rows, stops, strict=True):
        row[first], row[second] = -1.0, 1.0
    found: Floats = np.linalg.lstsq(rows, np.array(list(stops.values())), rcond=None)[0]
    return found


def _features(grey: Grey, sift: cv2.SIFT) -> _Features | None:
    """Return a photo's key points; None where there are too few for any match."""
    points, descriptors = sift.detectAndCompute(grey, None)
    if descriptors is None or len(points) < FEWEST_INLIERS:
        return None
    places = np.array([point.pt for point in points], dtype=np.float32)
    light = cv2.GaussianBlur(linear_light(grey), (0, 0), AROUND_POINT)
    column, row = np.round(places).astype(np.int64).T
    row, column = row.clip(0, grey.shape[0] - 1), column.clip(0, grey.shape[1] - 1)
    darkest = linear_light(np.ones(1, np.uint8))[0]
    around = np.log2(np.maximum(light[row, column], darkest)).astype(np.float64)
    return _Features(places, np.asarray(descriptors, dtype=np.float32), around)


def _light(grey: Grey) -> Literal["dark", "bright", "fair"]:
    """Say whether too little is left to match; a black or white ground around an object is fair."""
    darkest, brightest = np.percentile(grey, OBJECT_AT_LEAST) / 255
    mean = grey.mean() / 255
    if mean < DARK and brightest < MIDDLE:
        return "dark"
    return "bright" if mean > BRIGHT and darkest > MIDDLE else "fair"


def linear_light(grey: Grey) -> NDArray[np.float32]:
    """Return the light, 0 to 1, of 8-bit sRGB values: stops are ratios of light (IEC 61966-2-1)."""
    encoded = np.arange(256) / 255
    light = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.asarray(light[grey], dtype=np.float32)


def _matches(features: Sequence[_Features | None]) -> dict[tuple[int, int], _Matched]:
    """Return the pairs of photos that match, by their indices.

    Names say little of what photos show. So those that are left outside the largest group are
    compared with all in it, nearest by name first, until one matches; no more pairs than before.
    """
    count = len(features)
    compared = set(pairs(count))
    found = _matching(features, sorted(compared))
    left = len(compared)
    for photo in range(count):
        inside = _largest_group(list(found), count)
        if photo in inside:
            continue
        further = {(min(photo, n), max(photo, n)) for n in inside} - compared
        for pair in sorted(further, key=lambda pair: (pair[1] - pair[0], pair))[:left]:
            left -= 1
            joined = _matching(features, [pair])
            found |= joined
            if joined:
                break
    return found


def _matching(
    features: Sequence[_Features | None], compared: Sequence[tuple[int, int]]
) -> dict[tuple[int, int], _Matched]:
    """Return those of the pairs that match."""
    found = {}
    for first, second in compared:
        one, other = features[first], features[second]
        match = None if one is None or other is None else _match(one, other)
        if match is not None:
            found[first, second] = match
    return found


def _groups(linked: Sequence[tuple[int, int]], count: int) -> NDArray[np.int32]:
    """Return for each photo the number of the group that hangs together by pairs."""
    first, second = np.array(linked, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _largest_group(linked: Sequence[tuple[int, int]], count: int) -> list[int]:
    """Return the photos of the largest group."""
    groups = _groups(linked, count)
    return np.flatnonzero(groups == np.bincount(groups).argmax()).tolist()


def _together(linked: Sequence[tuple[int, int]], count: int) -> tuple[list[int], int]:
    """Return with how many others each photo matches, and the size of the largest group."""
    matched = np.bincount(np.array(linked, dtype=np.int64).ravel(), minlength=count)
    return [int(one) for one in matched], len(_largest_group(linked, count))


def _match(first: _Features, second: _Features) -> _Matched | None:
    """Match two photos' key points; None where they share too few."""
    found = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first.descriptors, second.descriptors, k=2)
    good = [two[0] for two in found if len(two) == 2 and two[0].distance < RATIO * two[1].distance]
    if len(good) < FEWEST_INLIERS:
        return None
    here, there = [one.queryIdx for one in good], [one.trainIdx for one in good]
    points, others = first.points[here], second.points[there]
    on_lines = _on_lines(points, others)
    if on_lines.sum() < FEWEST_INLIERS:
        return None
    moves = np.linalg.norm(points - others, axis=1)
    lighter = second.light[there] - first.light[here]
    moving = moves >= LOOSE
    return _Matched(
        float(np.median(moves[on_lines])),
        float(np.median(lighter[on_lines])),
        int(_on_lines(points[moving], others[moving]).sum()),
    )


def _on_lines(points: NDArray[np.float32], others: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return which matches [N] lie on the epipolar lines that most of them agree on."""
    if len(points) < FEWEST_INLIERS:
        return np.zeros(len(points), dtype=bool)
    cv2.setRNGSeed(SEED)
    inliers = cv2.findFundamentalMat(points, others, cv2.FM_RANSAC, LOOSE, 0.99)[1]
    return np.zeros(len(points), dtype=bool) if inliers is None else inliers.ravel() > 0


def _problems(
    names: Sequence[str],
    sharp: Sequence[float],
    light: Sequence[str],
    matched: Sequence[int],
    placed: int,
) -> list[str]:
    """Say what is wrong, one sentence each."""
    usual = float(np.median(sharp))
    listed = {
        "blurred (next to the others)": [
            n for n, s in zip(names, sharp, strict=True) if s < BLURRED * usual
        ],
        "too dark": [n for n, found in zip(names, light, strict=True) if found == "dark"],
        "too bright": [n for n, found in zip(names, light, strict=True) if found == "bright"],
        "not matched with any other photo": [
            n for n, m in zip(names, matched, strict=True) if m == 0
        ],
    }
    problems = [
        f"{len(found)} {what}: {listed_names(found, MOST_LISTED)}"
        for what, found in listed.items()
        if found
    ]
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
