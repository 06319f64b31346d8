"""Whether another program's splats lie where the cameras look: a check of finished renders.

Trainers move, turn and scale scenes to suit themselves, and some forget to undo it. Then everything
is scored as if the training had failed, which would be a false statement about the method. What
tells is the training views, which the program has seen. Splats in another frame

* show from each camera something that is no more like its own photo than like the others'. So it
  is when a scene was turned about its own middle, which leaves extents, and a white ground, alone;
  or
* show the photos worse than one flat colour would, each photo's mean, and lie elsewhere than the
  points that the program was given, or are spread otherwise.

Neither half of the second is enough: a short training may be worse than a flat colour, and a good
one may fill the distance. A change of a few per cent passes, and shows as low scores. A program
that hardly trained at all cannot be told from one that turned the scene: the message names both.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mattgs_ops.capture.scene import Scene
from mattgs_ops.capture.sparse import are_on_object
from mattgs_ops.errors import StageError
from mattgs_ops.frozen import Background
from mattgs_ops.score.evaluate import RenderedViews
from mattgs_ops.splat.files.ply import read_ply

Floats = NDArray[np.float64]

OWN_SHARE = 0.5  # of the views, whose own photo must be the likest; by chance it is one in all
SMALL = 64  # pixels of the longest side at which renders and photos are compared
SEEN_OPACITY = 0.1  # fainter splats are no part of what is there
SAME = 0.05  # of the photos' usual squared distance from each other
VISIBLE_LOGIT = float(np.log(SEEN_OPACITY / (1 - SEEN_OPACITY)))
FARTHEST = 0.25  # of the points' spread, between the medians of splats and points
WIDEST = 1.5  # times the points' spread, or that part of it
MIDDLE_HALF = (25, 75)  # percentiles: far splats of a background do not count


def check_frame(folder: Path, scene: Scene, splats_ply: Path, background: Background) -> None:
    """Look at the training views' renders in ``folder``.

    Raises :class:`StageError` when they say that the splats are in another frame.
    """
    shown, photos = _pictures(folder)
    own = np.concatenate([((a - b) ** 2).mean(axis=1) for a, b in zip(shown, photos, strict=True)])
    flat = np.concatenate([_spread(b) for b in photos])
    likest = np.concatenate([are_likest(a, b) for a, b in zip(shown, photos, strict=True)])
    away, wider = _displacement(scene, splats_ply, background)
    elsewhere = away > FARTHEST or not 1 / WIDEST < wider < WIDEST
    if own.mean() > flat.mean() and elsewhere:
        trouble = (
            f"worse, {_decibels(own):.1f} dB, than one flat colour would, {_decibels(flat):.1f} dB"
        )
    elif likest.mean() < OWN_SHARE:
        trouble = (
            f"so that {likest.sum()} of {len(likest)} are liker to their own photo than to another"
        )
    else:
        return
    raise StageError(
        f"its splats show the training views {trouble}: expected splats in the frame of the "
        f"cameras that were given, found the middle of them {away:.2g} times the points' spread "
        f"away from theirs, and spread {wider:.2g} times as far. Have the program keep the "
        "cameras' frame, neither centred, scaled nor turned (docs/trainers.md); or, where they lie "
        "where the points do, train for longer"
    )


def _pictures(folder: Path) -> tuple[list[Floats], list[Floats]]:
    """Return renders and photos of the training views, small; one array [V, P] for each size."""
    found: dict[tuple[int, ...], list[tuple[Floats, Floats]]] = {}
    for view in RenderedViews.load(folder).views:
        if view.split == "train":
            photo = _read(folder / "truth" / "train" / f"{view.name}.png")
            render = _read(folder / "renders" / "train" / f"{view.name}.png")
            found.setdefault(photo.shape, []).append((render, photo))
    pairs = [tuple(zip(*same, strict=True)) for same in found.values()]
    return [_rows(renders) for renders, _ in pairs], [_rows(photos) for _, photos in pairs]


def _rows(pictures: tuple[Floats, ...]) -> Floats:
    return np.stack([picture.ravel() for picture in pictures])


def _spread(photos: Floats) -> Floats:
    """Return the mean square [V] of photos [V, P] about their own mean colour."""
    colours = photos.reshape(len(photos), -1, 3)
    out: Floats = ((colours - colours.mean(axis=1, keepdims=True)) ** 2).mean(axis=(1, 2))
    return out


def are_likest(shown: Floats, photos: Floats) -> NDArray[np.bool_]:
    """Say for each render [V, P] whether its own photo is nearer than every other.

    Photos that are nearly the same as its own, of a burst or there twice, do not count.
    """
    # |a - b|² without |a|², which is the same for all photos
    squares = (photos**2).sum(axis=1)
    apart = squares[None] - 2 * shown @ photos.T
    own = np.diag(apart)
    between = squares[:, None] + squares[None] - 2 * photos @ photos.T
    others = np.where(between <= SAME * np.median(between), np.inf, apart)
    np.fill_diagonal(others, np.inf)
    nearer: NDArray[np.bool_] = own < others.min(axis=1)
    return nearer


def _decibels(mean_squares: Floats) -> float:
    return float(-10 * np.log10(max(mean_squares.mean(), 1e-12)))


def _displacement(scene: Scene, splats_ply: Path, background: Background) -> tuple[float, float]:
    """Return how far from the given points the splats lie, and how much farther spread.

    Both in units of the points' spread; infinitely far where no splat is visible.
    """
    splats = read_ply(splats_ply)
    visible = splats.opacity_logits.numpy() > VISIBLE_LOGIT
    if not visible.any():
        return float("inf"), 0.0
    points = scene.points()
    chosen = are_on_object(points)
    given = points.xyz[chosen] if background == "nobg" and chosen.any() else points.xyz
    if not len(given):
        return 0.0, 1.0  # nothing to compare with
    there, extent = _place(given)
    centre, spread = _place(splats.means.numpy()[visible].astype(np.float64))
    return float(np.linalg.norm(centre - there)) / extent, spread / extent


def _place(xyz: Floats) -> tuple[Floats, float]:
    """Return the median [3] of positions [N, 3], and the diagonal of their middle half."""
    low, high = np.percentile(xyz, MIDDLE_HALF, axis=0)
    return np.median(xyz, axis=0), max(float(np.linalg.norm(high - low)), 1e-12)


def _read(path: Path) -> Floats:
    with Image.open(path) as image:
        pixels = np.asarray(image, dtype=np.float64) / 255
    scale = min(1.0, SMALL / max(pixels.shape[:2]))
    size = max(1, round(pixels.shape[1] * scale)), max(1, round(pixels.shape[0] * scale))
    small: Floats = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    return small
