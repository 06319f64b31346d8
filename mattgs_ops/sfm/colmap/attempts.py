"""One attempt at a reconstruction, from key points to points; and further ones, if need be.

Runs in the worker process. Every step up from the usual way is recorded as a fallback.
"""

import time
from collections.abc import Container, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

from mattgs_ops.capture.scene import FROM_OBJECT
from mattgs_ops.errors import StageError
from mattgs_ops.progress import Progress
from mattgs_ops.sfm import given_poses, look_alikes
from mattgs_ops.sfm.colmap import features, mapping, matching
from mattgs_ops.sfm.colmap.features import Features, Matches, Pair
from mattgs_ops.sfm.colmap.guides import Guides, beside, sets_of
from mattgs_ops.sfm.colmap.job import DATABASE_FILE, MODEL_FOLDER, Answer, Job
from mattgs_ops.sfm.colmap.lenses.build import build_cameras, check_lenses
from mattgs_ops.sfm.colmap.matching import Verified, partners
from mattgs_ops.sfm.colmap.moving_object import (
    MOST_EXPLAINED,
    STANDS_STILL,
    explains_more,
    share_contradicting,
    shares_explained,
)
from mattgs_ops.sfm.colmap.steps import UNITS, Attempt, further_attempts
from mattgs_ops.sfm.lost_views import advice, of_exif

Pairs = dict[Pair, Verified]


def run(job: Job, progress: Progress) -> Answer:
    """Do the whole job; the model lands in ``<workspace>/model``.

    When fewer than 95 % of the views are registered, further attempts keep more key points and
    compare all pairs, then seek fainter ones by COLMAP's own SIFT, each of which takes several
    times as long; the best is kept. Where the stage would fail, one more leaves EXIF's
    focal length aside.
    """
    import pycolmap

    config = job.sfm
    pycolmap.set_random_seed(config.seed)
    first = Attempt(job, config, Answer(config.mode, threads=job.threads), progress)
    failure: StageError | None = None
    try:
        attempt(first)
    except StageError as error:
        failure = error
    best = first.answer
    for number, further in enumerate(further_attempts(job), 2):
        if len(best.registered) >= further.below * len(job.views):
            continue
        step = f"{len(best.registered)} of {len(job.views)} views registered: {further.what}"
        again = further.answer(best, step)
        try:
            settings = further.job, further.config
            next_ = Attempt(*settings, again, progress, 0.0, further.thorough, number)
            attempt(next_, better_than=best)
            again, failure = next_.answer, None
        except StageError as error:
            failure = failure and error
        if len(again.registered) > len(best.registered):
            best = again
        else:
            best.seconds, best.cpu_seconds = again.seconds, again.cpu_seconds
            best.fallbacks = further.in_vain(best, again, step)
    if failure is not None:
        raise StageError("\n".join([str(failure), *advice(best), *of_exif(job)]))
    note = f"{len(best.registered)} of {len(job.views)} views, {best.points} points"
    progress(UNITS, UNITS, note)
    return best


def attempt(state: Attempt, better_than: Answer | None = None) -> None:
    """Reconstruct once; write model and key points unless ``better_than`` has as many views."""
    with state.step("extract"):
        found = _extract(state)
    mode = state.answer.mode
    model = _reconstruct(state, [f.of_mode(mode) for f in found])
    answer = state.answer
    answer.registered = _names(state.job, model)
    answer.points = model.num_points3D()
    if answer.points:
        answer.reprojection_error = float(model.compute_mean_reprojection_error())
    if better_than is None or len(answer.registered) > len(better_than.registered):
        folder = state.folder / MODEL_FOLDER
        folder.mkdir(exist_ok=True)
        model.write_binary(folder)
        state.write_keypoints(found, [f.rows_of_mode(mode) for f in found])


def _names(job: Job, model: Any) -> list[str]:
    """Return the names of a model's views."""
    return [job.views[number - 1].name for number in sorted(model.reg_image_ids())]


def _extract(state: Attempt) -> list[Features]:
    """Climb the ladder until the object has key points enough."""
    job, answer = state.job, state.answer
    found: list[Features] = []
    for reason, how in features.ladder(state.config, thorough=state.thorough):
        if reason is not None:
            if features.enough(found) or answer.mode == "original":
                break
            answer.tell(f"too few key points inside masks: {reason}")
        found = features.extract(
            job.views,
            state.config,
            how,
            job.threads,
            lambda done, total, note: state.report("extract", done, total, note),
        )
    if answer.mode == "masked" and not features.enough(found):
        answer.mode = "shared"
        answer.tell("too few key points inside masks: mode shared instead of masked")
    for view, f in zip(job.views, found, strict=True):
        answer.keypoints[view.name] = f.found
    answer.used = {
        "whole": sum(int(f.whole.sum()) for f in found),
        "masked": sum(int(f.masked.sum()) for f in found),
    }
    return found


def _match(state: Attempt, found: Sequence[Features], cameras: Sequence[Any]) -> Pairs:
    """Match by looks what poses are to come from: whole photos, or their masked key points."""
    config, job, answer = state.config, state.job, state.answer
    name, rows = next(iter(sets_of(found, answer.mode).items()))
    descriptors = [f.descriptors[r] for f, r in zip(found, rows, strict=True)]
    with state.step("match"):
        pairs = matching.choose_pairs(descriptors, config, job.threads)
        out = matching.match_and_verify(
            pairs,
            descriptors,
            rows,
            [f.positions for f in found],
            [f.inside for f in found],
            cameras,
            config.seed,
            job.threads,
            lambda done, total, note: state.report("match", done, total, note),
        )
    answer.pairs[name] = len(pairs)
    answer.matches[name] = sum(len(v.matches) for v in out.values())
    if name == "whole":
        state.whole_matches = {pair: v.matches for pair, v in out.items()}
    inliers = {pair: len(v.matches) for pair, v in out.items()}
    answer.partners = partners(inliers, [view.name for view in job.views])
    if not out:
        raise StageError(
            f"matching: none of {len(pairs)} pairs of views shows the same scene "
            f"({matching.LEAST_MATCHES} or more consistent matches); expected overlapping "
            "photos of a textured, unmoving scene"
        )
    return out


def _reconstruct(state: Attempt, found: Sequence[Features]) -> Any:
    """Find poses where they are not known, then points, from training views alone."""
    job = state.job
    cameras = build_cameras(job.views, state.config)
    pairs = {} if job.poses_known else _match(state, found, cameras)
    if state.answer.mode == "shared":
        sides = [max(view.width, view.height) for view in job.views]
        if matching.stand_still(pairs, [f.positions for f in found], sides):
            return _of_object(state, found, STANDS_STILL)
        return _of_whole_or_object(state, found, pairs, cameras)
    return _place(state, found, pairs, cameras)


def _of_object(state: Attempt, found: Sequence[Features], reason: str) -> Any:
    """Reconstruct from the key points inside masks alone."""
    state.answer.mode = "masked"
    state.answer.tell(f"{reason}: {FROM_OBJECT}")
    return _reconstruct(state, [f.of_mode("masked") for f in found])


def _of_whole_or_object(
    state: Attempt, found: Sequence[Features], pairs: Pairs, cameras: Sequence[Any]
) -> Any:
    """Reconstruct from whole photos, and where that fails the object, from the object alone.

    Returns the model that explains the object's matches; ``state`` has the answer of that
    one, with the seconds of both.
    """
    before, positions = deepcopy(state.answer), [f.positions for f in found]
    on_object = {pair: one.on_object for pair, one in pairs.items() if one.on_object is not None}

    def explained(model: Any, those: Container[Pair]) -> tuple[float | None, float | None]:
        return shares_explained(
            {pair: one for pair, one in on_object.items() if pair in those},
            mapping.posed(model),
            mapping.rays_by(model, positions),
        )

    def place(state: Attempt, pairs: Pairs) -> Any:
        return _place(state, found, pairs, cameras)

    motion: dict[str, float | None] = {"contradicting": share_contradicting(on_object)}
    model, failure, kept = None, None, pairs
    of_placed: float | None = 0.0
    try:
        model, kept = look_alikes.place(state, pairs, positions, place)
        motion["shared"], of_placed = explained(model, kept)
        sure = look_alikes.sure_pairs(pairs)
        if len(sure & on_object.keys()) >= given_poses.FEWEST_PAIRS:
            # pairs of sides that look alike contradict right poses; these show the room, too
            of_placed = max(explained(model, sure)[1] or 0.0, of_placed or 0.0)
    except StageError as error:
        failure = error
    if of_placed is not None and of_placed < MOST_EXPLAINED:
        # clocks run on, whichever way is taken
        before.seconds, before.cpu_seconds = state.answer.seconds, state.answer.cpu_seconds
        alone = replace(state, answer=before)
        try:
            other = _of_object(alone, found, "the object moves against its surroundings")
            motion["masked"], _ = explained(other, kept)
            if model is None or explains_more(motion["masked"], motion["shared"]):
                model, state.answer = other, alone.answer
        except StageError as error:
            failure = failure or error
    if model is None:
        assert failure is not None
        raise failure
    state.answer.object_motion = motion
    return model


def _place(state: Attempt, found: Sequence[Features], pairs: Pairs, cameras: Sequence[Any]) -> Any:
    """Find poses from matched pairs where they are not known, then points."""
    job = state.job
    positions = [f.positions for f in found]
    database, photos = state.folder / DATABASE_FILE, Path(job.views[0].photo).parent
    known = all(view.intrinsics is not None for view in job.views)
    options = mapping.pipeline_options(state.config, intrinsics_known=known)
    sets = sets_of(found, state.answer.mode)
    matches: dict[Pair, Matches] = {}
    with beside(job.threads) as helpers:
        if job.poses_known:
            model = mapping.with_poses(job.views, cameras)
            given_poses.ask_photos(state, found, next(iter(sets.values())), cameras, model)
            guides = Guides(state, found, sets, helpers)
            guides.settle([model])
        else:
            sets.pop(next(iter(sets)))  # matched already
            held_out = [view.held_out for view in job.views]
            matches = {p: v.matches for p, v in pairs.items() if not any(held_out[n] for n in p)}
            mapping.write_database(database, job.views, cameras, positions, pairs)
            guides = Guides(state, found, sets, helpers)
            model = _map(state, database, photos, options, guides, known=known)
        for more in guides.finish():
            matches = matching.merged(matches, more)
    if not matches:
        state.answer.tell("no pair of views matches along epipolar lines")
        return model
    with state.step("triangulate"):
        mapping.write_database(database, job.views, cameras, positions, matches)
        state.report("triangulate", 0, 1, "points with poses held fixed")
        out = state.folder / "triangulated"
        return mapping.triangulate(model, database, photos, out, options)


def _map(
    state: Attempt, database: Path, photos: Path, options: Any, guides: Guides, *, known: bool
) -> Any:
    views, out = len(state.job.views), state.folder / "mapped"
    # this thread's seconds alone: helpers match meanwhile
    with state.step("map", time.thread_time):
        if state.config.mapper == "global":
            state.report("map", 0, 1, "globally")
            models = mapping.global_(database, photos, out, state.config, known=known)
        else:
            models = mapping.incremental(
                database,
                photos,
                out,
                options,
                views,
                lambda n: state.report("map", n, views, f"{n} of {views} views registered"),
                guides.see,
            )
        if models:
            guides.settle(models)
            moved = mapping.adjust(models[0], state.job.views, database, intrinsics_known=known)
            state.answer.cropped = [state.job.views[number - 1].name for number in moved]
            check_lenses(models[0], moved)
    if not models:
        raise StageError(
            "structure-from-motion: no two views could be placed relative to each other; expected "
            "photos from different positions of a textured, unmoving scene"
        )
    state.answer.models = len(models)
    state.answer.components = [_names(state.job, model) for model in models]
    state.answer.mapped_points = models[0].num_points3D()
    return models[0]
