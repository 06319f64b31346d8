"""Masks that all views agree on: what several photos show corrects the map of each.

Of several networks the mean's maps are the photos' own, or one's that are surely better
(``own_maps``). A single photo's map leaks into clutter or misses a part, in other places in every
photo. Two more sources correct it: the silhouettes of the other views (``silhouettes``), and votes
of all maps on the splats of a short training (``splats.votes``). ``decision`` compares both with
the maps, for the capture and for each view: on textured ground votes make the masks; on plain
ground they may mean nothing, and maps are only corrected.

``agree(scene, capture, out)`` copies a scene with new masks, soft maps and votes of the points, and
a new ``masks.json``. Only training views decide: masks of held-out views follow from that decision
and their own map and photo, and change nothing else. The scene's
``soft/`` and ``masks.json`` are those of the photos' own maps.
``extra["agreement"]`` of the new scene holds the decision with its numbers.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import SoftMap, map_folders, mask_name
from mattgs_ops.capture.photos import read_rgb
from mattgs_ops.capture.scene import PreparedCapture, Scene, View
from mattgs_ops.object_masks import own_maps, silhouettes
from mattgs_ops.object_masks.agreed_masks import keep, write
from mattgs_ops.object_masks.map_scores import ViewMaps
from mattgs_ops.object_masks.photo_evidence.colours import ColourEvidence, cut_by_colours
from mattgs_ops.object_masks.photo_evidence.plain_ground import PlainGround, correct_by_ground
from mattgs_ops.object_masks.splats.labels import read_shrunk, shrunk
from mattgs_ops.object_masks.splats.surfaces import train_surfaces
from mattgs_ops.object_masks.vote_variants import Outcome, VoteVariants
from mattgs_ops.parallel import over_views
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.splat.photos import camera_at

# Of the short training. Half the steps at 256 pixels leave splats that straddle outlines: even with
# each labelled by the true masks they reach an IoU of 0.92 on the bundled hexapod.
ITERATIONS, RESOLUTION = 1000, 400
VOTING = 256  # pixels, of the views that vote: the photos' maps are coarse


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
    were, and ``extra["agreement"]["none"]`` says why; those that contradict each other at points
    that two photos show are told all the same. Unregistered views keep their masks. A view whose
    mask is empty in the end is named in ``extra["dropped"]``.
    """
    shutil.copytree(scene.folder, out, ignore=_single_networks, dirs_exist_ok=True)
    report = MaskReport.load(scene.folder / "masks.json")
    if report.source != "u2net":
        reason = f"masks are {report.source}, nothing to vote on"
        return keep(scene, out, report, reason, threads=threads)
    views = [view for view in scene.views if view.camera is not None]
    cameras = [camera_at(view, silhouettes.SIDE) for view in views]
    trained = [view.split == "train" for view in views]
    shown = [camera_at(view, RESOLUTION) for view in views]
    photos = over_views(_photo, views, shown, threads=threads)
    offered = _offered(scene, views, shown, threads)
    networks = own_maps.choose(offered, cameras, photos, trained)
    plain, by_ground = correct_by_ground(photos, networks.maps, trained, threads=threads)
    own, outlines = networks.maps, networks.outlines
    if plain.used:
        own = by_ground
        outlines = silhouettes.predict(cameras, list(map(shrunk, own, cameras)), trained)
    if outlines is None:
        return keep(scene, out, report, "the photos' maps share no object", threads=threads)
    splats = train_surfaces(
        scene, iterations=ITERATIONS, resolution=RESOLUTION, threads=threads, progress=progress
    )
    names = [view.name for view in views]
    variants = VoteVariants(
        views=ViewMaps.of(names, photos, own, outlines, cameras, trained, plain_ground=plain.used),
        voting=[camera_at(view, VOTING) for view in views],
        shown=shown,
        points=scene.points().xyz.astype(np.float64),
        threads=threads,
    )
    found = variants.best(splats)
    colours, soft = cut_by_colours(photos, own, found.maps, trained, threads=threads)
    agreed = {view.name: one for view, one in zip(found.decision.views, soft, strict=True)}
    around = [cameras[k] for k in variants.views.trained_views]
    record = _decision_record(found, colours, plain, networks, around)
    return write(
        scene, capture, out, report, agreed, record, plain_ground=plain.used, threads=threads
    )


def _decision_record(
    found: Outcome,
    colours: ColourEvidence | None,
    plain: PlainGround,
    networks: own_maps.OwnMaps,
    around: Sequence[Camera],
) -> dict[str, Any]:
    """Return the decision as JSON values, rounded; ``around`` are the training views' cameras."""
    middle = None if found.votes is None else found.votes.place.middle
    share = None if found.ground is None else found.ground.share
    by_colours = None if colours is None else asdict(colours)
    summary = {
        "ground_share": share,
        "ground_cut": found.ground_cut,
        "half_needed": found.half_needed,
        "haze_votes": found.haze_votes,
        "colours": by_colours,
        "plain_ground": asdict(plain),
        "network": networks.chosen,
        "networks": networks.worths,
        "seen_within": None if middle is None else silhouettes.seen_within(around, middle),
    }
    record: dict[str, Any] = _rounded(asdict(found.decision) | summary)
    return record


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4)
    if isinstance(value, Mapping):
        return {key: _rounded(one) for key, one in value.items()}
    return [_rounded(one) for one in value] if isinstance(value, list | tuple) else value


def _photo(view: View, camera: Camera) -> NDArray[np.uint8]:
    """Read a photo [H, W, 3] RGB at a camera's size."""
    size = camera.intrinsics.width, camera.intrinsics.height
    small = cv2.resize(read_rgb(view.photo), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _offered(
    scene: Scene, views: Sequence[View], cameras: Sequence[Camera], threads: int
) -> list[list[SoftMap]]:
    """Return the maps [H, W] of the mean and of each network, one a view, at the cameras' sizes."""
    folders = map_folders(scene.folder / "soft")
    paths = ([folder / mask_name(view.name) for view in views] for folder in folders)
    return [over_views(read_shrunk, one, cameras, threads=threads) for one in paths]


def _single_networks(folder: str, names: list[str]) -> list[str]:
    """Return what of a scene's folder is not copied: after the choice it is of no use."""
    below = Path(folder)
    return [name for name in names if below.name == "soft" and (below / name).is_dir()]
