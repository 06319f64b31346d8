"""Spoil an exact mask the way that votes and saliency err, to learn how to mend it.

The idea of perturbed masks is that of CascadePSP (Cheng et al. 2020). What is imitated here:
outlines that wander, that lie too far out or in, that swallow gaps and drop wires; parts that are
missing or too many (smooth patches beside the outline, as shadows are) or in doubt; steps that are
sharp here and washed out there, streaks as of long splats, haze, and the resolution of maps that
are rendered smaller than the photo.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import disc

Map = NDArray[np.float32]
REACH = 24.0  # pixels: how far from the outline distances count
WANDER = (0.3, 4.0)  # pixels: standard deviation of an outline's way to and fro
LENGTHS = (3.0, 40.0)  # pixels along the outline, over which it wanders
BIAS = 1.2  # pixels: standard deviation of an outline's way out or in
SOFT = (0.3, 4.0)  # pixels: how wide the step at the outline is, and how it varies along it
STREAKS = (3, 25)  # pixels: lengths
HAZE = 0.12  # at most, of what is outside; inside, at most thrice that is missing
SHRUNK = (1.5, 5.0)  # times smaller than the photo are the maps
PATCH = (5.0, 26.0)  # pixels: radii of what is missing, too much, or in doubt
HARD = 0.25  # share of maps that are thresholded


def spoil_mask(rng: np.random.Generator, truth: NDArray[np.uint8]) -> Map:
    """Return a map [H, W] in [0, 1] of an exact mask [H, W] (0 to 255), as others would draw it."""
    binary = (truth > 127).astype(np.uint8)
    if rng.random() < 0.35:
        binary = cv2.morphologyEx(binary, cv2.MORPH_OPEN, disc(int(rng.integers(1, 6))))
    if rng.random() < 0.35:
        binary = cv2.morphologyEx(binary, cv2.MORPH_CLOSE, disc(int(rng.integers(1, 6))))
    for _ in range(int(rng.integers(0, 4)) if rng.random() < 0.45 else 0):
        binary[_patch(rng, binary)] = rng.random() < 0.5
    away = _signed_distance(binary) + rng.normal(0, BIAS)
    amplitude = _between(rng, WANDER)
    for share in (0.8, 0.6):  # two lengths at once: a slow drift, and teeth
        length = _between(rng, LENGTHS)
        away += amplitude * share * _smooth_noise(rng, binary.shape, length)
    width = np.log(_between(rng, SOFT)) + 0.7 * _smooth_noise(rng, binary.shape, LENGTHS[1])
    map_: Map = (1 / (1 + np.exp(-np.clip(away / np.exp(width), -20, 20)))).astype(np.float32)
    if rng.random() < 0.3:
        map_ = _streaked(rng, map_)
    for _ in range(int(rng.integers(1, 3)) if rng.random() < 0.2 else 0):
        doubt = _patch(rng, binary)
        map_[doubt] = (map_[doubt] + 3 * rng.uniform(0.2, 0.8)) / 4
    if rng.random() < 0.7:
        map_ = _through_small(map_, float(rng.uniform(*SHRUNK)))
    if rng.random() < 0.5:
        map_ = _hazy(rng, map_)
    if rng.random() < HARD:
        map_ = (map_ >= 0.5).astype(np.float32)
    return map_


def outline_of(binary: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return pixels (x, y) [K, 2] next to which a mask [H, W] of 0 and 1 begins or ends."""
    ys, xs = np.nonzero(cv2.morphologyEx(binary, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)))
    return np.stack([xs, ys], axis=1).astype(np.int32)


def _between(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    """Draw a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]))))


def _patch(rng: np.random.Generator, binary: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return an ellipse [H, W] around a pixel of the outline; nothing where there is none."""
    patch = np.zeros_like(binary)
    places = outline_of(binary)
    if len(places):
        x, y = places[int(rng.integers(len(places)))].tolist()
        size = 2 * _between(rng, PATCH), 2 * _between(rng, PATCH)
        cv2.ellipse(patch, ((x, y), size, float(rng.uniform(0, 180))), 1, -1)
    return patch > 0


def _signed_distance(binary: NDArray[np.uint8]) -> Map:
    """Pixels to the outline, positive inside, at most ``REACH``."""
    inside = cv2.distanceTransform(binary, cv2.DIST_L2, 3)
    outside = cv2.distanceTransform(1 - binary, cv2.DIST_L2, 3)
    return np.asarray(np.clip(inside - outside, -REACH, REACH), dtype=np.float32)


def _smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], length: float) -> Map:
    """Noise [H, W] of mean 0 and deviation 1 that changes over ``length`` pixels."""
    rows, columns = (max(2, round(side / length) + 1) for side in shape)
    small = rng.normal(0, 1, (rows, columns)).astype(np.float32)
    noise = cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray(noise / max(float(noise.std()), 1e-6), dtype=np.float32)


def _streaked(rng: np.random.Generator, map_: Map) -> Map:
    """Blur along a line where smooth noise says so."""
    length = int(rng.integers(*STREAKS))
    line = np.zeros((length, length), np.float32)
    ends = np.array([np.cos(angle := rng.uniform(0, np.pi)), np.sin(angle)]) * length / 2
    middle = np.full(2, (length - 1) / 2)
    first, last = (tuple(round(v) for v in middle + side * ends) for side in (-1, 1))
    cv2.line(line, first, last, 1.0)
    blurred = cv2.filter2D(map_, -1, line / max(float(line.sum()), 1.0))
    share = np.clip(_smooth_noise(rng, map_.shape, LENGTHS[1]) + 0.5, 0, 1)
    return np.asarray(map_ + share * (blurred - map_), dtype=np.float32)


def _hazy(rng: np.random.Generator, map_: Map) -> Map:
    """Take from the inside and add to the outside, by smooth noise."""
    missing, haze = rng.uniform(0, 3 * HAZE), rng.uniform(0, HAZE)
    less, more = (np.abs(_smooth_noise(rng, map_.shape, LENGTHS[1] / 2)) for _ in range(2))
    hazy = map_ * (1 - missing * less) + haze * more * (1 - map_)
    return np.asarray(np.clip(hazy, 0, 1), dtype=np.float32)


def _through_small(map_: Map, factor: float) -> Map:
    """Shrink a map and stretch it again, as maps that are rendered small are."""
    height, width = map_.shape
    small = (max(2, round(width / factor)), max(2, round(height / factor)))
    shrunk = cv2.resize(map_, small, interpolation=cv2.INTER_AREA)
    stretched = cv2.resize(shrunk, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(stretched, 0, 1), dtype=np.float32)
