"""Photos and masks to a scene: checked, reconstructed in a worker process, reported in full.

Modes (``SfmConfig.mode``):

- ``original``: key points of whole photos; everything from them;
- ``masked``: key points inside masks only, everything from them (the paper's);
- ``shared``: poses from whole photos; points from their matches joined by matches of the object's
  key points along epipolar lines.

Poses are found for all photos together. All points are then triangulated anew, with those poses
held fixed, from the training photos alone: what a training starts from knows no held-out photo.

A capture that brings cameras *and* points needs none of this: both are taken as they are.

Whatever the mode, the training views' masks then vote on every point
(``SparsePoints.object_share``).
"""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mattgs_ops.capture import sparse, visual_hull
from mattgs_ops.capture.formats import colmap_model
from mattgs_ops.capture.photos import NAMED, perhaps_cropped
from mattgs_ops.capture.scene import PreparedCapture, Scene, View
from mattgs_ops.capture.sparse import SparseModel
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.naming import listed_names
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.sfm import (
    alignment,
    assemble,
    figure,
    given_points,
    given_poses,
    look_alikes,
    lost_views,
)
from mattgs_ops.sfm.checks import check, check_given_cameras, keeps_poses, mask_path
from mattgs_ops.sfm.colmap.job import KEYPOINTS_FILE, MODEL_FOLDER, Answer, Job, JobView
from mattgs_ops.sfm.colmap.process import run_worker
from mattgs_ops.sfm.world_units import check_units

LOG_FILE, FIGURE_FILE = "sfm.log", "sfm.png"
WORKSPACE = "sfm-workspace"
# Fewer points on the object than this do not start a training; the visual hull is filled then.
FEW_OBJECT_POINTS = 100


def reconstruct(
    capture: PreparedCapture,
    masks: Path,
    config: SfmConfig,
    out: Path,
    *,
    soft: Path | None = None,
    threads: int = 1,
    progress: Progress = no_progress,
) -> Scene:
    """Write a scene folder to ``out`` and return the scene.

    ``masks`` holds ``NAME.png`` for every view, 255 = object; ``soft``, where given, the saliency
    maps under the same names, which then come along as ``out/soft``. ``threads`` serve files,
    extraction and matching and never change a result. Besides the scene, ``out/sfm.log`` keeps
    COLMAP's log, ``out/keypoints.npz`` the key points (``names`` [V], ``counts`` [V], ``xy``
    [K, 2] pixels of the scene's photos, ``inside`` [K]) and their verified matches (``pairs``
    [P, 2] of views, ``pair_counts`` [P], ``matches`` [M, 2] rows of both views' key points; none
    where cameras are given), ``out/points.ply`` the points and ``out/sfm.png`` a picture of it all.

    Raises :class:`InputError` for photos or masks that cannot be used, before any work, and
    :class:`StageError` when nothing, or fewer than ``config.min_registered`` of the views, could
    be registered, or when COLMAP crashed. Given poses of fewer views than that, in units, or about
    an origin, in which no splats can be trained are an :class:`InputError` that says what to do
    (``world_units``).
    """
    empty = check(capture, masks, threads=threads)
    if keeps_poses(capture, config):
        check_given_cameras(capture, config.min_registered)
    known = given_points.given_model(capture, config)
    if known is None:
        views, model, answer = _solve(capture, masks, config, out, soft, threads, progress)
        source = "triangulated"
    else:
        source, answer = "given", _given_answer(capture, known)
        views, model, _ = assemble.write_views(capture, masks, known, out, soft, threads=threads)
        given_points.write_no_keypoints(capture, out / KEYPOINTS_FILE)
    points = assemble.vote(views, model, threads=threads)
    extra = _report(capture, views, answer, empty) | {"points_source": source}
    on_object = len(sparse.on_object(points).xyz)
    if on_object < FEW_OBJECT_POINTS:
        extra["fallbacks"].append(
            f"{on_object} points on the object, fewer than {FEW_OBJECT_POINTS}: "
            f"{config.random_points:,} random ones added inside the masks' visual hull"
        )
        extra["points_source"] = (
            f"{source} and random in the visual hull"
            if len(points.xyz)
            else "random in the visual hull"
        )
        points = visual_hull.joined(
            points, visual_hull.fill(views, config.random_points, config.seed)
        )
    if extra["poses"] == "given":
        trained = [v.camera for v in views if v.split == "train" and v.camera is not None]
        check_units(capture.name, trained, points.xyz)
    extra["points"] = len(points.xyz)
    extra["object_points"] = len(sparse.on_object(points).xyz)
    extra["triangulated"] = len(model.xyz) if known is None else 0
    colmap_model.write_model(model, out / "sparse" / "0")
    sparse.write_ply(points, out / "points.ply")
    scene = Scene(capture.name, out, views, extra)
    scene.save(points)
    figure.draw(scene, out / FIGURE_FILE)
    return scene


def _solve(
    capture: PreparedCapture,
    masks: Path,
    config: SfmConfig,
    out: Path,
    soft: Path | None,
    threads: int,
    progress: Progress,
) -> tuple[tuple[View, ...], SparseModel, Answer]:
    """Let COLMAP find what is not known, in a process of its own; write the scene's views."""
    workspace = out / WORKSPACE
    if workspace.exists():
        shutil.rmtree(workspace)
    workspace.mkdir(parents=True)
    job = _job(capture, masks, config, workspace, threads)
    try:
        answer = run_worker(job, out / LOG_FILE, progress)
        if not job.poses_known:
            _require_registered(capture, answer, config.min_registered, lost_views.of_exif(job))
        found = colmap_model.read_model(workspace / MODEL_FOLDER)
        if job.poses_known:
            found = given_points.with_held_out(found, capture)
            posed = {image.name for image in found.images.values()}
            answer.registered = [v.name for v in capture.views if v.photo.name in posed]
        views, model, conversions = assemble.write_views(
            capture, masks, found, out, soft, threads=threads
        )
        assemble.write_keypoints(workspace / KEYPOINTS_FILE, conversions, out / KEYPOINTS_FILE)
    finally:
        shutil.rmtree(workspace, ignore_errors=True)
    return views, model, answer


def _given_answer(capture: PreparedCapture, model: SparseModel) -> Answer:
    """Say what a model that came with the capture holds."""
    registered = [view.name for view in capture.views if view.camera is not None]
    return Answer("given", registered=registered, models=1, points=len(model.xyz))


def _job(
    capture: PreparedCapture, masks: Path, config: SfmConfig, workspace: Path, threads: int
) -> Job:
    given, keep_poses = capture.cameras_are == "given", keeps_poses(capture, config)
    rows = []
    for view in capture.views:
        if keep_poses and (view.camera is None or view.split == "test"):
            continue  # without a camera it stays so; a held-out photo shapes no point
        intrinsics = pose = None
        if given and view.camera is not None:
            i = view.camera.intrinsics
            intrinsics = (i.fx, i.fy, i.cx, i.cy)
            if keep_poses:
                pose = (*view.camera.rotation.ravel().tolist(), *view.camera.translation.tolist())
        mask = str(mask_path(masks, view).resolve())
        rows.append(
            JobView(
                view.name,
                str(view.photo.resolve()),
                mask,
                view.width,
                view.height,
                intrinsics,
                pose,
                view.focal,
                view.lens,
                held_out=view.split == "test",
                taken=view.taken,
            )
        )
    return Job(str(workspace.resolve()), tuple(rows), config.model_dump(mode="json"), threads)


def _require_registered(
    capture: PreparedCapture, answer: Answer, least: float, notes: Sequence[str] = ()
) -> None:
    """Refuse a model of fewer than a share of the views, naming those that are missing and why.

    ``notes`` end the message.
    """
    share = len(answer.registered) / len(capture.views)
    if share < least:
        raise StageError(
            f"structure-from-motion placed {len(answer.registered)} of {len(capture.views)} views "
            f"({share:.0%}), expected at least {least:.0%}\n"
            + "\n".join([*lost_views.warnings(capture, answer), *notes])
        )


def warnings(capture: PreparedCapture, answer: Answer) -> list[str]:
    """Return what a reader must know of the cameras, a sentence each."""
    sizes = {view.name: view.as_taken for view in capture.views}
    return [
        *lost_views.warnings(capture, answer),
        *given_poses.warnings(answer),
        *look_alikes.warnings(answer),
        *(perhaps_cropped(sizes, answer.cropped) if _estimated(answer) else ()),
    ]


def _cropped(answer: Answer) -> list[str]:
    """Say of which photos the lens's axis was found outside the middle."""
    if not answer.cropped:
        return []
    named = listed_names(answer.cropped, NAMED)
    return [f"{len(answer.cropped)} are cropped, by where the axis of their lens is: {named}"]


def _estimated(answer: Answer) -> bool:
    """Whether poses were sought, and did not come with the capture."""
    return "map" in answer.seconds


def _report(
    capture: PreparedCapture, views: tuple[View, ...], answer: Answer, empty: list[str]
) -> dict[str, Any]:
    """Everything that a reader of the results may ask of this stage."""
    counts = answer.keypoints
    whole, masked = (sum(c[k] for c in counts.values()) for k in (0, 1))
    return {
        "mode": answer.mode,
        "poses": "estimated" if _estimated(answer) else "given",
        "registered": len(answer.registered),
        "views": len(capture.views),
        "registered_share": len(answer.registered) / len(capture.views),
        "missing": [view.to_json() for view in lost_views.lost_views(capture, answer)],
        "second_groups": lost_views.second_groups(answer),
        "warnings": warnings(capture, answer),
        "poses_in_doubt": lost_views.in_doubt(capture, answer)
        or given_poses.in_doubt(answer)
        or look_alikes.in_doubt(answer),
        "empty_masks": empty,
        "dropped": empty,  # until other views lend them a mask
        "models": answer.models,
        "object_motion": {
            name: None if share is None else round(share, 4)
            for name, share in answer.object_motion.items()
        },
        "beside_object": answer.beside_object,
        "given_cameras": answer.given_cameras,
        "keypoints": {"original": whole, "masked": masked},
        "keypoint_reduction": 1 - masked / whole if whole else None,
        "keypoints_used": answer.used,
        "pairs": answer.pairs,
        "matches": answer.matches,
        "mapped_points": answer.mapped_points,
        "reprojection_error": answer.reprojection_error,
        "seconds": {step: round(s, 3) for step, s in answer.seconds.items()},
        "cpu_seconds": {step: round(s, 3) for step, s in answer.cpu_seconds.items()},
        "threads": answer.threads,
        "fallbacks": [*answer.fallbacks, *_cropped(answer)],
        "cropped": answer.cropped,
        "pose_error": pose_error(capture, views) if _estimated(answer) else None,
    }


def pose_error(capture: PreparedCapture, views: tuple[View, ...]) -> Mapping[str, float] | None:
    """Compare estimated poses with those that came with the capture, if any did.

    None where too few did, or all cameras lie on a line, about which any turn would fit.
    """
    truth = {v.name: v.camera for v in capture.views if v.camera is not None}
    ours = {v.name: v.camera for v in views if v.camera is not None}
    if len(set(truth) & set(ours)) < alignment.LEAST_POINTS:
        return None
    try:
        return dict(vars(alignment.pose_error(ours, truth)))
    except InputError:
        return None
