"""Plain ground: maps corrected by how far each colour is from the ground's.

Black cloth, a white sweep and a dark room are smooth: their colour is a polynomial of the place in
the photo. A network fills the air under a crane's jib or between a temple's columns, where the
photo shows that very ground. Each photo's ground is fitted to what its map is sure is no object, in
CIELAB, and each pixel gets what it deviates in units of the ground's noise. How often the object
deviates that much, and how often the ground, is counted over all training views by what the maps
are sure of. The ratio of both corrects the map by Bayes' rule. What the map saw less than half of
stays as it was, unless it is the largest part: a colour chart is no ground, and not the object's.

Shadows are the ground, darker: that a pixel is darker and has the ground's hue is no evidence for
the object. On textured or cluttered ground the two kinds of pixels deviate alike. How much their
histograms overlap says so, and the maps stay as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from mattgs_ops.capture.masks import HALF, SoftMap, parts_apart
from mattgs_ops.parallel import over_views
from mattgs_ops.segment.grabcut import SURE_BACKGROUND, SURE_OBJECT, doubt_disc

DEGREE = 3  # of the polynomial: light that falls off, and the bend of a sweep
ROUNDS = 6  # of the fit: what deviates more than three times the median is left out of the next
LEAST_GROUND = 0.05  # of the photo's pixels must surely be ground
NOISE = 0.5  # of CIELAB's units, added to the ground's own: rounding to 8 bits
# In standard deviations; about half an octave wide. The two columns of small hue differences and
# the rows below -2 are a shadow.
LIGHTNESS = (-np.inf, -24, -16, -11, -7.5, -5, -3.3, -2, 2, 3.3, 5, 7.5, 11, 16, 24, np.inf)
HUE = (0.0, 2, 3.3, 5, 7.5, 11, 16, 24, np.inf)
SHADOW_ROWS, SHADOW_COLUMNS = 7, 2
UNSEEN = 1e-4  # share of a histogram's bin that nothing fell into
# The range that a map is clipped to. Networks fill gaps as surely as they see objects, and miss
# little that they give nothing.
SUREST = (0.01, 0.9)
# Two classes whose histograms share w, told apart by the larger one, have an IoU of
# (1 - w / 2) / (1 + w / 2). It must be that of the bundled network on its validation photos, 0.86.
LARGEST_OVERLAP = 0.15

Residual = NDArray[np.int64]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class PlainGround:
    """``overlap``: which share of their deviations object and ground have in common, 0 to 1.

    ``used``: whether the maps were corrected by them.
    """

    overlap: float
    used: bool


def correct_by_ground(
    photos: Sequence[NDArray[np.uint8]],
    maps: Sequence[SoftMap],
    trained: Sequence[bool],
    *,
    threads: int = 1,
) -> tuple[PlainGround, list[SoftMap]]:
    """Return how plain the ground is, and the maps [H, W] in [0, 1], corrected where it is.

    ``photos`` [H, W, 3] RGB have the maps' size. Only views that are ``trained`` on are counted; a
    held-out view is corrected by what they show. A photo with too little ground keeps its map.
    """
    bins = over_views(deviations, photos, maps, threads=threads)
    counted = [
        (one, soft)
        for one, soft, use in zip(bins, maps, trained, strict=True)
        if use and one is not None
    ]
    objects = sum(_histogram(one[soft > SURE_OBJECT]) for one, soft in counted)
    grounds = sum(_histogram(one[soft < SURE_BACKGROUND]) for one, soft in counted)
    if not np.any(objects) or not np.any(grounds):
        return PlainGround(1.0, used=False), list(maps)
    objects, grounds = (_shares(np.asarray(one)) for one in (objects, grounds))
    overlap = float(np.minimum(objects, grounds).sum())
    if overlap > LARGEST_OVERLAP:
        return PlainGround(overlap, used=False), list(maps)
    ratio = objects / grounds
    shadow = ratio[:SHADOW_ROWS, :SHADOW_COLUMNS]
    np.minimum(shadow, 1.0, out=shadow)
    corrected = [
        soft if one is None else _posterior(soft, ratio.ravel()[one])
        for one, soft in zip(bins, maps, strict=True)
    ]
    return PlainGround(overlap, used=True), corrected


def deviations(photo: NDArray[np.uint8], soft: SoftMap) -> Residual | None:
    """Return each pixel's bin [H, W] by its deviation from the photo's ground; None without ground.

    Bins count lightness (:data:`LIGHTNESS`) times hue (:data:`HUE`).
    """
    ground = cv2.erode((soft < SURE_BACKGROUND).astype(np.uint8), doubt_disc(soft.shape)) > 0
    if ground.mean() < LEAST_GROUND:
        return None
    lab = cv2.cvtColor(photo.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    powers = _powers(*soft.shape)
    places, colours = powers[ground], lab[ground]
    kept = np.ones(len(places), np.bool_)
    for _ in range(ROUNDS):
        factors = _fit(places[kept], colours[kept])
        off = colours - places @ factors
        size = np.linalg.norm(off, axis=1)
        kept = size <= 3 * max(float(np.median(size)), NOISE)
    scaled = (lab - powers @ factors) / np.sqrt(off[kept].var(axis=0) + NOISE**2)
    rows = np.digitize(scaled[..., 0], LIGHTNESS[1:-1])
    columns = np.digitize(np.hypot(scaled[..., 1], scaled[..., 2]), HUE[1:-1])
    bins: Residual = (rows * (len(HUE) - 1) + columns).astype(np.int64)
    return bins


def _fit(places: Floats, colours: Floats) -> Floats:
    """Return the factors [10, 3] of powers [N, 10] that come closest to colours [N, 3].

    By the normal equations: powers of -1 to 1 up to the third are far from dependent.
    """
    square = places.T @ places
    factors: Floats = np.linalg.solve(square.astype(np.float64), places.T @ colours)
    return factors.astype(np.float32)


@lru_cache(maxsize=2)  # a capture's photos have one size, or two: upright and not
def _powers(height: int, width: int) -> Floats:
    """Return x^i y^j with i + j up to the degree [H, W, 10]; x and y go from -1 to 1.

    Photos of a size share the array: it cannot be written to.
    """
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    powers = [x**i * y**j for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    stacked: Floats = np.stack(powers, axis=-1)
    stacked.flags.writeable = False
    return stacked


def _histogram(bins: Residual) -> NDArray[np.float64]:
    """Return one view's share of pixels in each bin [lightness, hue]; zeros where it has none."""
    shape = len(LIGHTNESS) - 1, len(HUE) - 1
    counts = np.bincount(bins, minlength=shape[0] * shape[1]).reshape(shape)
    return counts / max(len(bins), 1)


def _shares(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smooth a histogram by its neighbours, to a sum of one; no bin is empty."""
    smooth = gaussian_filter(counts / counts.sum(), 0.7) + UNSEEN
    shares: NDArray[np.float64] = smooth / smooth.sum()
    return shares


def _posterior(soft: SoftMap, ratio: NDArray[np.float64]) -> SoftMap:
    """Return the map after evidence: odds of the map times the ratio of likelihoods."""
    prior = soft.clip(*SUREST)
    odds = prior / (1 - prior) * ratio
    posterior: SoftMap = (odds / (1 + odds)).astype(np.float32)
    apart = parts_apart(posterior >= HALF, soft >= HALF)  # a colour chart, a scale bar
    posterior[apart] = soft[apart]
    return posterior
