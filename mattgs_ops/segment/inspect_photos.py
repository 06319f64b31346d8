"""A quick look at photos before anything long is started: what is wrong, and what it may lead to.

``inspect(capture)`` takes a prepared capture and says which photos are blurred, too dark or too
bright, and with how many others each can be matched. Photos that hang together by matches are what
structure-from-motion can place. Exposures are compared on matched points, as whole photos show
other things.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np

from mattgs_ops.capture.photos import perhaps_cropped, read_rgb
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.capture.video import relative_sharpness
from mattgs_ops.naming import listed_names
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment import quick_matches
from mattgs_ops.segment.quick_matches import LOOSE, Floats, Grey, Matches, Pair

# What COLMAP wants to place one more photo. Where only the object turns, what else moves is matched
# wrongly, and 15 to 20 of such matches lie on some epipolar lines by chance
FEWEST_OF_OBJECT = 30
# Of the median sharpness: the motion of a hand, not another distance. A Gaussian of 1.5 pixels at
# 640 leaves 0.02 to 0.20 on the rover, dino, lego and the fox, whose own photos have 0.43 and more
BLURRED = 0.25
DARK, BRIGHT = 0.08, 0.92  # mean of a photo, of 1: little is left to match
# unless a hundredth of the pixels, an object's, is on the other side of the middle: white that is
# exposed two stops too short still is, by sRGB's curve
OBJECT_AT_LEAST, MIDDLE = (1, 99), 0.5
UNEVEN = 0.25  # stops, standard deviation over photos: cameras set exposure in thirds of a stop
AT_SMALL_ANGLES = "take photos at every 10 degrees or less, or walk around it"
FEW_PHOTOS = 12  # neighbours farther apart than 30 degrees are hardly matched by SIFT
MOST_LISTED = 8  # photos in one sentence

STANDS_STILL = (
    "most photos show the same things in the same places: the camera stands still, and poses will "
    f"come from the object alone; {AT_SMALL_ANGLES}"
)


@dataclass(frozen=True)
class Inspected:
    """What was seen of the photos, and sentences about what is wrong."""

    names: tuple[str, ...]
    matched: tuple[int, ...]  # photos that share FEWEST_INLIERS matches with this one
    placed: int  # photos that hang together: about as many will register
    problems: tuple[str, ...]
    stands_still: bool = False  # the camera, so that only matches on the object count
    matches: Mapping[Pair, Matches] = field(default_factory=dict)  # none where cameras are given


def inspect(
    capture: PreparedCapture, *, estimate: bool = False, progress: Progress = no_progress
) -> Inspected:
    """Look at all photos of a capture; ``progress`` counts each photo once.

    Where cameras came along nothing is matched, unless a run will ``estimate`` all anew.
    """
    names = tuple(view.name for view in capture.views)
    sharp, light, features = [], [], []
    given = capture.cameras_are == "given" and not estimate
    sift = cv2.SIFT.create(nfeatures=quick_matches.FEATURES)
    for index, view in enumerate(capture.views):
        photo = read_rgb(view.photo)
        grey = quick_matches.shrunk(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY))
        sharp.append(relative_sharpness(np.ascontiguousarray(photo[..., ::-1])))
        light.append(_light(grey))
        if not given:
            features.append(quick_matches.key_points(grey, sift))
        progress(index + 1, len(names), view.name)
    without = [view.name for view in capture.views if given and view.camera is None]
    links = {} if given else quick_matches.match(features)
    stands_still = sum(link.moved < LOOSE for link in links.values()) > len(links) / 2
    if given:
        matched, placed = [len(names) - 1] * len(names), len(names)
    else:
        least = FEWEST_OF_OBJECT if stands_still else 0
        linked = [pair for pair, link in links.items() if link.moving >= least]
        matched, placed = quick_matches.together(linked, len(names))
    problems = _problems(names, sharp, light, matched, placed)
    if not given:
        problems += perhaps_cropped({view.name: view.as_taken for view in capture.views})
    uneven = float(exposures({pair: link.stops for pair, link in links.items()}, len(names)).std())
    if uneven > UNEVEN:
        problems.append(f"exposure differs between photos: {uneven:.2f} stops (standard deviation)")
    if stands_still:
        problems.append(STANDS_STILL)
    if without:
        listed = listed_names(without, MOST_LISTED)
        problems.append(f"{len(without)} came without a camera: {listed}")
    placed -= len(without)
    return Inspected(names, tuple(matched), placed, tuple(problems), stands_still, links)


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


def _light(grey: Grey) -> Literal["dark", "bright", "fair"]:
    """Say whether too little is left to match; a black or white ground around an object is fair."""
    darkest, brightest = np.percentile(grey, OBJECT_AT_LEAST) / 255
    mean = grey.mean() / 255
    if mean < DARK and brightest < MIDDLE:
        return "dark"
    return "bright" if mean > BRIGHT and darkest > MIDDLE else "fair"


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
