"""Write what the views agree on: a scene with new masks, maps, votes of the points and reports.

``masks.json`` says what each mask is like and how it was made; ``extra["agreement"]`` of the scene
holds the decision, which views kept their own mask, and how much the others' changed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mattgs_ops.capture import sparse, visual_hull
from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.masks import (
    Mask,
    SoftMap,
    clean,
    mask_name,
    quality,
    read_map,
    threshold,
)
from mattgs_ops.capture.photos import read_rgb, write_png
from mattgs_ops.capture.scene import PreparedCapture, Scene, View
from mattgs_ops.object_masks.contradictions.shared_outlines import masks_at_shared_outlines
from mattgs_ops.object_masks.contradictions.shared_points import masks_at_shared_points
from mattgs_ops.object_masks.photo_evidence.edges import to_photo_edges
from mattgs_ops.object_masks.silhouettes import CONTRADICT, iou
from mattgs_ops.parallel import over_views
from mattgs_ops.segment.mask_report import MaskReport, ViewReport, border_share, flags_of
from mattgs_ops.segment.outline.refine import OutlineRefiner
from mattgs_ops.sfm.assemble import vote


@dataclass(frozen=True)
class _Written:
    """A view's row of the mask report, its mask's share of the border, and what became of it.

    ``overlap`` is the IoU with the network's own mask; None where that was kept.
    """

    row: ViewReport
    border: float
    overlap: float | None
    empty: bool


def write(
    scene: Scene,
    capture: PreparedCapture,
    out: Path,
    before: MaskReport,
    agreed: Mapping[str, SoftMap],
    decision: dict[str, Any],
    *,
    plain_ground: bool,
    threads: int,
) -> Scene:
    """Write masks, maps and votes into ``out``, a copy of ``scene``, and return the new scene.

    ``agreed`` has the map [H, W] in [0, 1] of each view that has a camera, by name; ``before`` is
    the report on the photos' own masks; ``decision`` goes into ``extra["agreement"]``. On
    ``plain_ground``, which has no outlines of its own to be drawn to, the outline's network looks
    from afar, too.
    """
    old = {row.name: row for row in before.views}
    refiner = OutlineRefiner()

    def write_one(view: View) -> _Written:
        own, soft = old[view.name], agreed.get(view.name)
        # the scene's, from which the lens's distortion is gone as from its photos
        truth = view.coverage if capture.masks_are == "truth" else None
        mask = None if soft is None else _mask(soft, view, refiner, plain_ground=plain_ground)
        return _write_view(view, out, own, soft, mask, truth)

    written = over_views(write_one, scene.views, threads=threads)
    overlaps = {one.row.name: one.overlap for one in written if one.overlap is not None}
    differs = [overlaps.get(one.row.name, 1.0) < CONTRADICT for one in written]
    shares, borders = [one.row.foreground for one in written], [one.border for one in written]
    flags = flags_of(shares, borders, differs)
    agreed_scene = Scene.load(out)
    rows = [replace(one.row, flags=flag) for one, flag in zip(written, flags, strict=True)]
    reports, found = _compared(agreed_scene, before.source, rows, threads)
    MaskReport(before.source, "votes", before.model, reports).save(out / "masks.json")
    points = vote(agreed_scene.views, read_model(out / "sparse" / "0"), threads=threads)
    points = visual_hull.with_random(points, scene.points(), agreed_scene.views)
    sparse.write_ply(points, out / "points.ply")
    extra = dict(scene.extra) | {
        "points": len(points.xyz),
        "object_points": len(sparse.on_object(points).xyz),
        "dropped": [one.row.name for one in written if one.empty],
        "agreement": decision
        | {
            "kept": [one.row.name for one in written if one.overlap is None],
            "overlap": overlaps,
            "mean_iou_before": before.mean_iou,
        }
        | found,
    }
    done = replace(agreed_scene, extra=extra)
    done.save(points)
    return done


def _write_view(
    view: View,
    out: Path,
    old: ViewReport,
    soft: SoftMap | None,
    mask: Mask | None,
    truth: Path | None,
) -> _Written:
    """Write a view's mask and map; the network's own stay where the views agree on none."""
    own = read_map(out / "masks" / mask_name(view.name))
    if soft is None or mask is None or not mask.any():
        return _Written(old, border_share(own), None, empty=not own.any())
    full = cv2.resize(soft, (view.width, view.height), interpolation=cv2.INTER_LINEAR)
    write_png(out / "masks" / mask_name(view.name), mask)
    write_png(out / "soft" / mask_name(view.name), np.rint(full * 255).astype(np.uint8))
    scored = None if truth is None else quality(mask, read_map(truth), full)
    row = ViewReport(view.name, float((mask > 0).mean()), (), scored)
    overlap = round(iou(own > 0, mask > 0), 4)
    return _Written(row, border_share(mask), overlap, empty=False)


def keep(scene: Scene, out: Path, before: MaskReport, reason: str, *, threads: int) -> Scene:
    """Return the copy of ``scene`` in ``out`` with its masks as they are, and the reason.

    They are compared with each other all the same: a user's masks may be in the wrong order.
    """
    copied = Scene.load(out)
    reports, found = _compared(copied, before.source, before.views, threads)
    replace(before, views=reports).save(out / "masks.json")
    agreement = {"none": reason} | found
    kept = replace(copied, extra=dict(scene.extra) | {"agreement": agreement})
    kept.save(scene.points())
    return kept


def _compared(
    scene: Scene, source: str, rows: Sequence[ViewReport], threads: int
) -> tuple[tuple[ViewReport, ...], dict[str, Any]]:
    """Test a scene's masks at the points that two photos show, and by what they predict of others.

    Returns the views' rows, those that contradict others flagged, and what ``extra["agreement"]``
    holds of both tests. Masks that cover whole photos have no outlines.
    """
    shared, contradict = masks_at_shared_points(scene, threads=threads)
    outlines = masks_at_shared_outlines(scene, threads=threads) if source != "none" else None
    wrong = {*contradict, *(outlines.contradict if outlines else ())}
    flagged = tuple(
        replace(row, flags=(*row.flags, "contradicts")) if row.name in wrong else row
        for row in rows
    )
    return flagged, {
        "shared_points": {"share": shared.shared, "contradict": contradict},
        "shared_outlines": outlines
        and asdict(outlines) | {"contradict": list(outlines.contradict)},
    }


def _mask(soft: SoftMap, view: View, refiner: OutlineRefiner, *, plain_ground: bool) -> Mask:
    """Cut a map at the photo's size; its outline moves to edges, then to where the object ends."""
    size = view.width, view.height
    full = np.clip(cv2.resize(soft, size, interpolation=cv2.INTER_CUBIC), 0, 1)
    photo = read_rgb(view.photo)
    if plain_ground:
        full = refiner.mend(photo, full)
    at_edges = clean(to_photo_edges(clean(threshold(full)), photo))
    return clean(refiner.refine(photo, full, at_edges))
