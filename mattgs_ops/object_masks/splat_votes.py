"""What all views say of each surface: splats ask the photos' maps, and show the answer.

Splats of a short training are surfaces that all photos share. Each asks every view how salient the
pixels are that it colours: Σ blending weight × map / Σ blending weight, from the rasteriser. The
answers, rendered from each camera, are maps on which the views agree. Splats are asked once more
about these maps, with doubt taken out, which spreads what most views say to the parts that few are
sure of. What lies on or under the plane that the object stands on (``ground_plane``) is not object;
what is attached to splats that are surely object may be (``attached_parts``), whatever the maps
say. Splats far in front of the object belong to nothing that stands there; they are left out, so
that a floater before a camera hides nothing.

On textureless ground splats fill empty space as they please, and their answers mean nothing:
``decision`` says when to believe them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks import ground_plane
from mattgs_ops.object_masks.attached_parts import attached
from mattgs_ops.object_masks.silhouettes import around_half, iou
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import backward, render
from mattgs_ops.splat.training.initialise import SH_C0
from mattgs_ops.splat.training.optimise import select

# What the first round's answers count for in the second: nothing, everything, in between a share.
# Single maps miss more of an object than they invent, so little agreement is enough.
FIRST_NO, FIRST_YES = 0.125, 0.375
SURE = 0.5  # an answer from here on says that the splat is object
SHARE = 0.5  # of a pixel's colour that must come from the object's splats
REACH = 0.9  # share of the sure splats within the object's radius
BESIDE = 1.2  # radii: ground goes on beyond the object; a base plate, which it stands on, does not
FRONT = 2.0  # radii before the object's middle, beyond which a splat is no part of it
CONTACT = 0.04  # of the radius: height above the plane below which a splat is ground
SOLID = 0.3  # opacity of splats that tell where surfaces are
BLACK = (0.0, 0.0, 0.0)
UNSEEN = 1e-6  # blending weight, pixels: such a splat was asked by nobody
UNSEEN_BY_OTHERS = 1e-3  # the same where one view's weight is taken off, and rounding is left
LEVELS = (0.125, 0.25, 0.375, 0.5)  # answers from which on a splat may be object


Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Place:
    """Where the object is: middle [3] and radius in world units, and the ground, if any."""

    middle: NDArray[np.float64]
    radius: float
    ground: ground_plane.Plane | None


@dataclass(frozen=True)
class Votes:
    """What splats say of each view, in two ways.

    ``predicted`` [V] are the answers that splats give a view without its own map, [H, W] in [0, 1],
    at least 0.5 where they say object; ``agreement`` is the IoU with the own map of each view that
    voted, of splats that are each wholly object or not at all; ``soft_agreement`` that
    of ``predicted``, where splats may be half. ``sure`` and ``whole`` [V] are the views' maps by
    all votes, without and with attached parts; ``place`` is where the object is.
    """

    predicted: list[SoftMap]
    agreement: list[float]
    soft_agreement: list[float]
    sure: list[SoftMap]
    whole: list[SoftMap]
    place: Place


@dataclass(frozen=True)
class Answers:
    """Blending weights [V, N], and weights times map [V, N], of splats in views."""

    weight: Floats
    weighted_map: Floats

    def labels(self, without: int | None = None) -> Floats:
        """Return each splat's mean saliency [N], 0 where nobody asked; ``without`` one view."""
        weight, total = self.weight.sum(axis=0), self.weighted_map.sum(axis=0)
        if without is not None:
            weight, total = weight - self.weight[without], total - self.weighted_map[without]
        found: Floats = np.where(weight > UNSEEN_BY_OTHERS, total / weight.clip(min=UNSEEN), 0)
        return found.astype(np.float32)


def collect(
    splats: Splats,
    asked: Sequence[Camera],
    shown: Sequence[Camera],
    maps: Sequence[SoftMap],
    *,
    trained: Sequence[bool] | None = None,
    threads: int = 1,
) -> Votes | None:
    """Let the views vote; None where no splat is salient to them.

    ``asked`` are the cameras of the views at the size of asking, ``shown`` at that of the answer.
    ``maps`` [H, W] in [0, 1], of any size; views whose map shows nothing, and those that are not
    ``trained`` on (None: all are), do not vote and get the others' answer.
    """
    trained = trained or [True] * len(maps)
    speaking = [bool((m >= SURE).any()) and heard for m, heard in zip(maps, trained, strict=True)]
    voters = [camera for camera, speaks in zip(asked, speaking, strict=True) if speaks]
    heard = [soft for soft, speaks in zip(maps, speaking, strict=True) if speaks]
    if not heard:
        return None
    answers = ask(splats, voters, heard, threads=threads)
    weights = answers.weight.sum(axis=0)
    around = [camera for camera, heard in zip(asked, trained, strict=True) if heard]
    place = locate(splats, answers.labels(), weights, around)
    if place is None:
        return None
    labels = standing(splats, answers.labels(), place)
    first = [surer(show(splats, labels, camera, place, threads=threads)) for camera in around]
    again = ask(splats, around, first, threads=threads).labels()
    sure = (standing(splats, again, place) >= SURE).astype(np.float32)
    joined = whole(splats, again, weights, place)
    by_all = [
        [show(splats, found, camera, place, threads=threads) for camera in shown]
        for found in (sure, joined)
    ]
    predicted, firm, soft = _by_others(splats, asked, maps, speaking, answers, place, threads)
    return Votes(predicted, firm, soft, by_all[0], by_all[1], place)


def _by_others(
    splats: Splats,
    cameras: Sequence[Camera],
    maps: Sequence[SoftMap],
    speaking: Sequence[bool],
    answers: Answers,
    place: Place,
    threads: int,
) -> tuple[list[SoftMap], list[float], list[float]]:
    """Predict every view from the other views' votes; see :class:`Votes` for what is returned.

    From which answer on a splat is object is not known: the one of :data:`LEVELS` that meets the
    views' own maps best is taken.
    """
    own, labels, soft, voter = [], [], [], 0
    for camera, mine, speaks in zip(cameras, maps, speaking, strict=True):
        own.append(_shrunk(mine, camera) >= SURE)
        labels.append(answers.labels(voter if speaks else None))
        soft.append(show(splats, labels[-1], camera, place, threads=threads))
        voter += speaks
    heard = [index for index, mask in enumerate(own) if mask.any() and speaking[index]]
    met = {level: [iou(soft[k] >= level, own[k]) for k in heard] for level in LEVELS}
    best = float(LEVELS[int(np.argmax([np.mean(met[level]) for level in LEVELS]))])
    firm = []
    for k in heard:
        either = (labels[k] >= best).astype(np.float32)
        firm.append(iou(show(splats, either, cameras[k], place, threads=threads) >= SHARE, own[k]))
    return [around_half(one, best) for one in soft], firm, met[best]


def ask(
    splats: Splats, cameras: Sequence[Camera], maps: Sequence[SoftMap], *, threads: int = 1
) -> Answers:
    """Ask each of V views how salient the pixels are that each of N splats colours.

    ``maps`` are [H, W] in [0, 1] of any size; they are shrunk to the cameras' sizes.
    """
    weights, totals = [], []
    for camera, soft in zip(cameras, maps, strict=True):
        small = torch.from_numpy(_shrunk(soft, camera))
        shown = render(splats, camera, BLACK, sh_degree=0, threads=threads)
        seen = backward(shown, torch.zeros_like(shown.image), pixel_map=small).seen
        weights.append(seen.weight.numpy().copy())
        totals.append(seen.weighted_map.numpy().copy())
    return Answers(np.stack(weights), np.stack(totals))


def _shrunk(soft: SoftMap, camera: Camera) -> SoftMap:
    size = camera.intrinsics.width, camera.intrinsics.height
    small: SoftMap = cv2.resize(soft, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return small


def locate(
    splats: Splats, labels: Floats, weights: Floats, cameras: Sequence[Camera]
) -> Place | None:
    """Find the object among the splats; None where no splat is salient to its views."""
    xyz = splats.means.numpy().astype(np.float64)
    surface = solid(splats, weights)
    sure = xyz[surface & (labels > SURE)]
    if len(sure) < ground_plane.FEWEST_POINTS:
        return None
    middle = np.median(sure, axis=0)
    radius = float(np.quantile(np.linalg.norm(sure - middle, axis=1), REACH))
    distances = np.linalg.norm(xyz - middle, axis=1) / radius
    beside = (distances > BESIDE) & (distances < ground_plane.REACH)
    around = xyz[surface & (labels <= SURE) & beside]
    centres = np.array([camera.centre for camera in cameras])
    return Place(middle, radius, ground_plane.find(around, radius, centres))


def standing(splats: Splats, labels: Floats, place: Place) -> Floats:
    """Return the labels [N], 0 for what lies on the ground or under it, if there is ground."""
    if place.ground is None:
        return labels
    heights = place.ground.heights(splats.means.numpy().astype(np.float64))
    return np.where(heights < CONTACT * place.radius, 0, labels).astype(np.float32)


def whole(splats: Splats, labels: Floats, weights: Floats, place: Place) -> Floats:
    """Return 1 for splats [N] that are surely object or attached to it, 0 for all others."""
    means = splats.means.numpy().astype(np.float64)
    distances = np.linalg.norm(means - place.middle, axis=1) / place.radius
    raised = standing(splats, np.ones_like(labels), place) > 0
    belongs = attached(splats, labels >= SURE, solid(splats, weights), raised, distances)
    return belongs.astype(np.float32)


def solid(splats: Splats, weights: Floats) -> NDArray[np.bool_]:
    """Return which splats [N] show where surfaces are: opaque, and seen by the views."""
    opaque: NDArray[np.bool_] = torch.sigmoid(splats.opacity_logits).numpy() > SOLID
    return opaque & (weights > UNSEEN)


def surer(soft: SoftMap) -> SoftMap:
    """Stretch a map of first answers [H, W] so that doubt is left only between the two bounds."""
    stretched: SoftMap = (soft - np.float32(FIRST_NO)) / np.float32(FIRST_YES - FIRST_NO)
    return stretched.clip(0, 1)


def show(
    splats: Splats, labels: Floats, camera: Camera, place: Place, *, threads: int = 1
) -> SoftMap:
    """Render labels [N] as a camera sees them, [H, W] in [0, 1], black where nothing is."""
    _, depths = camera.project(splats.means.numpy().astype(np.float64))
    _, middle = camera.project(place.middle[None])
    index = torch.from_numpy(np.flatnonzero(depths > middle[0] - FRONT * place.radius))
    kept = select(splats, index)
    grey = torch.from_numpy(labels)[index][:, None].expand(-1, 3)
    painted = replace(kept, sh_dc=((grey - 0.5) / SH_C0).contiguous())
    image = render(painted, camera, BLACK, sh_degree=0, threads=threads).image
    soft: SoftMap = image[..., 0].clamp(0, 1).numpy()
    return soft
