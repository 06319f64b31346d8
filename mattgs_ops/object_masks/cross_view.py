"""Agreement between views: the saliency of all photos, voted on by splats, becomes their masks.

A single photo's map leaks into clutter or misses a part, elsewhere in every photo. A short 3DGS
training on the whole photos gives surfaces that all photos share. Each splat asks all views how
salient the pixels are that it colours: Σ blending weight × map / Σ blending weight, from the
rasteriser. The answers, rendered from each camera, are maps on which the views agree, with outlines
as sharp as the splats'. Splats are asked once more about these maps, with doubt taken out, which
spreads what most views say to the parts that few are sure of. What lies on or under the plane that
the object stands on (``support``) is not object; what is attached to splats that are surely object
is object too (``connect``), whatever the maps say. Rendered, these splats are the masks. Splats far
in front of the object belong to nothing that stands there; they are left out, so that a floater
before a camera hides nothing.

``agree(scene, capture, out)`` copies a scene with new masks, soft maps and votes of the points, and
a new ``masks.json``. The scene's ``soft/`` and ``masks.json`` are those of the photos' own maps.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.capture import sparse
from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.masks import Mask, SoftMap, clean, mask_name, quality, threshold, write_mask
from mattgs_ops.capture.scene import PreparedCapture, Scene, View
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.errors import StageError
from mattgs_ops.method import MethodConfig
from mattgs_ops.object_masks import ground_plane
from mattgs_ops.object_masks.attached_parts import attached
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.mask_report import MaskReport, ViewReport, border_share, flags_of
from mattgs_ops.sfm.assemble import vote
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.photos import size_at
from mattgs_ops.splat.rasterize import backward, render
from mattgs_ops.splat.training.initialise import SH_C0
from mattgs_ops.splat.training.optimise import select
from mattgs_ops.splat.training.train import PLY, train

# Of the short training. Half the steps at 256 pixels leave splats that straddle outlines: even with
# each labelled by the true masks they reach an IoU of 0.92 on the bundled hexapod.
ITERATIONS, RESOLUTION = 1000, 400
VOTING = 256  # pixels, of the views that splats ask: the photos' maps are coarse
# What the first round's answers count for in the second: nothing, everything, in between a share.
# Single maps miss more of an object than they invent, so little agreement is enough.
FIRST_NO, FIRST_YES = 0.125, 0.375
SURE = 0.5  # an answer from here on says that the splat is object
SHARE = 0.5  # of a pixel's colour that must come from the object's splats
REACH = 0.9  # share of the sure splats within the object's radius
FRONT = 2.0  # radii before the object's middle, beyond which a splat is no part of it
CONTACT = 0.04  # of the radius: height above the plane below which a splat is ground
SOLID = 0.3  # opacity of splats that tell where surfaces are
BLACK = (0.0, 0.0, 0.0)
UNSEEN = 1e-6  # blending weight, pixels: such a splat was asked by nobody

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Place:
    """Where the object is: middle [3] and radius in world units, and the ground, if any."""

    middle: NDArray[np.float64]
    radius: float
    ground: ground_plane.Plane | None


def agree(
    scene: Scene,
    capture: PreparedCapture,
    out: Path,
    *,
    threads: int = 1,
    progress: Progress = no_progress,
) -> Scene:
    """Write the scene with masks that agree to ``out`` and return it.

    Where the photos' maps share no object, or were not made by a network, the masks stay what they
    were; ``extra["agreement"]`` says what happened. Unregistered views keep their masks.
    """
    shutil.copytree(scene.folder, out, dirs_exist_ok=True)
    report = MaskReport.load(scene.folder / "masks.json")
    if report.source != "u2net":
        return _keep(scene, out, f"masks are {report.source}, nothing to vote on")
    views = [view for view in scene.views if view.camera is not None]
    maps = [_read(scene.folder / "soft" / mask_name(view.name)) for view in views]
    splats = _surfaces(scene, views, out / "surfaces", threads, progress)
    cameras = [_camera(view, VOTING) for view in views]
    with torch.no_grad():
        labels, weights = ask(splats, cameras, maps, threads=threads)
        place = locate(splats, labels, weights, cameras)
        if place is None:
            return _keep(scene, out, "the photos' maps share no object")
        labels = standing(splats, labels, place)
        first = [show(splats, labels, camera, place, threads=threads) for camera in cameras]
        again, _ = ask(splats, cameras, [surer(soft) for soft in first], threads=threads)
        labels = whole(splats, again, weights, place)
        cameras = [_camera(view, RESOLUTION) for view in views]
        shown = [show(splats, labels, camera, place, threads=threads) for camera in cameras]
    by_name = {view.name: soft for view, soft in zip(views, shown, strict=True)}
    return _write(scene, capture, out, report, by_name, place)


def ask(
    splats: Splats, cameras: Sequence[Camera], maps: Sequence[SoftMap], *, threads: int = 1
) -> tuple[Floats, Floats]:
    """Return each splat's mean saliency [N] in [0, 1] and the blending weight [N] behind it.

    ``maps`` are [H, W] in [0, 1] of any size; they are shrunk to the cameras' sizes.
    """
    weight, total = torch.zeros(len(splats)), torch.zeros(len(splats))
    for camera, soft in zip(cameras, maps, strict=True):
        size = camera.intrinsics.width, camera.intrinsics.height
        small = cv2.resize(soft, size, interpolation=cv2.INTER_AREA)
        shown = render(splats, camera, BLACK, sh_degree=0, threads=threads)
        asked = backward(shown, torch.zeros_like(shown.image), pixel_map=torch.from_numpy(small))
        weight += asked.seen.weight
        total += asked.seen.weighted_map
    return (total / weight.clamp(min=UNSEEN)).numpy(), weight.numpy()


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
    distances = np.linalg.norm(xyz - middle, axis=1)
    around = xyz[surface & (labels <= SURE) & (distances < ground_plane.REACH * radius)]
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


def _surfaces(
    scene: Scene, views: Sequence[View], folder: Path, threads: int, progress: Progress
) -> Splats:
    """Train for a short while on all registered photos, test views too: their masks are truth."""
    everything = replace(scene, views=tuple(replace(view, split="train") for view in views))
    train(
        everything,
        Condition(background="original", method="3dgs"),
        MethodConfig(),
        TrainConfig(checkpoint_every=0),
        iterations=ITERATIONS,
        resolution=RESOLUTION,
        seed=0,
        out=folder,
        threads=threads,
        progress=progress,
    )
    splats = read_ply(folder / PLY)
    shutil.rmtree(folder)
    return splats


def _write(
    scene: Scene,
    capture: PreparedCapture,
    out: Path,
    before: MaskReport,
    shown: dict[str, SoftMap],
    place: Place,
) -> Scene:
    """Write masks, soft maps, votes of the points and both reports."""
    old = {row.name: row for row in before.views}
    truths = {view.name: view.mask for view in capture.views if capture.masks_are == "truth"}
    rows, borders, kept = [], [], []
    for view in scene.views:
        soft = shown.get(view.name)
        mask = None if soft is None else _mask(soft, view)
        if soft is None or mask is None or not mask.any():
            kept.append(view.name)
            rows.append(old[view.name])
            borders.append(0.0)
            continue
        full = cv2.resize(soft, (view.width, view.height), interpolation=cv2.INTER_LINEAR)
        write_mask(out / "masks" / mask_name(view.name), mask)
        write_mask(out / "soft" / mask_name(view.name), np.rint(full * 255).astype(np.uint8))
        truth = truths.get(view.name)
        scored = None if truth is None else quality(mask, _bytes(truth), full)
        rows.append(ViewReport(view.name, float((mask > 0).mean()), (), scored))
        borders.append(border_share(mask))
    flags = flags_of([row.foreground for row in rows], borders)
    reports = tuple(replace(row, flags=flag) for row, flag in zip(rows, flags, strict=True))
    MaskReport(before.source, "votes", before.model, reports).save(out / "masks.json")
    agreed = Scene.load(out)
    points = vote(agreed.views, read_model(out / "sparse" / "0"))
    extra = dict(scene.extra) | {
        "object_points": len(sparse.on_object(points).xyz),
        "agreement": {
            "kept": kept,
            "ground_share": None if place.ground is None else round(place.ground.share, 4),
            "mean_iou_before": before.mean_iou,
        },
    }
    done = replace(agreed, extra=extra)
    done.save(points)
    return done


def _keep(scene: Scene, out: Path, reason: str) -> Scene:
    kept = replace(Scene.load(out), extra=dict(scene.extra) | {"agreement": {"none": reason}})
    kept.save(scene.points())
    return kept


def _mask(soft: SoftMap, view: View) -> Mask:
    full = cv2.resize(soft, (view.width, view.height), interpolation=cv2.INTER_CUBIC)
    return clean(threshold(full, SHARE))


def _camera(view: View, resolution: int) -> Camera:
    if view.camera is None:
        raise StageError(f"{view.name}: expected a camera")
    return view.camera.scaled(*size_at(view.width, view.height, resolution))


def _read(path: Path) -> SoftMap:
    return (_bytes(path) / np.float32(255)).astype(np.float32)


def _bytes(path: Path) -> NDArray[np.uint8]:
    pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if pixels is None:
        raise StageError(f"{path}: expected a readable image")
    return np.asarray(pixels, dtype=np.uint8)
