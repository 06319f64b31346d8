"""What an attempt leaves beside its model, and which attempts follow it."""

import numpy as np
import pytest

from mattgs_ops.capture.scene import FROM_OBJECT, Scene
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap.job import Answer, Job, JobView
from mattgs_ops.sfm.colmap.moving_object import epipolar_error
from mattgs_ops.sfm.colmap.steps import further_attempts


def job_of(
    views: int,
    focal: float | None = None,
    pose: tuple[float, ...] | None = None,
    **settings: object,
) -> Job:
    lens = (500.0, 500.0, 200.0, 150.0) if pose else None
    view = JobView("a.jpg", "a.png", "a.png", 400, 300, lens, pose, focal)
    config = SfmConfig.model_validate(settings)
    return Job("", (view,) * views, config.model_dump(mode="json"), 1)


def test_matches_of_whole_photos_are_kept_as_rows_of_their_key_points(box_scene: Scene) -> None:
    """Each pair's matched pixels lie on the epipolar lines of the scene's own cameras."""
    data = np.load(box_scene.folder / "keypoints.npz")
    assert len(data["matches"]) == data["pair_counts"].sum() == box_scene.extra["matches"]["whole"]
    starts = np.cumsum(data["counts"]) - data["counts"]
    cameras = {view.name: view.camera for view in box_scene.views}
    ends = np.cumsum(data["pair_counts"])
    for pair, end, count in zip(data["pairs"], ends, data["pair_counts"], strict=True):
        posed, rays = [], []
        for side, view in enumerate(pair):
            camera = cameras[str(data["names"][view])]
            assert camera is not None
            i = camera.intrinsics
            xy = data["xy"][starts[view] + data["matches"][end - count : end, side]]
            posed.append(camera)
            rays.append((xy - [i.cx, i.cy]) / [i.fx, i.fy])
        assert np.median(epipolar_error(posed[0], posed[1], rays[0], rays[1])) < 1.0


@pytest.mark.parametrize(
    ("matcher", "views", "expected"),
    [("auto", 120, "exhaustive"), ("auto", 121, "auto"), ("sequential", 30, "sequential")],
)
def test_further_attempts_keep_more_and_compare_all_pairs_where_that_is_bearable(
    matcher: str, views: int, expected: str
) -> None:
    job = job_of(views, matcher=matcher, upsample=False)
    more, fainter = further_attempts(job)
    for further in (more, fainter):
        assert further.config.matcher == expected
        assert further.config.upsample
        assert further.config.max_features == 8192  # COLMAP's own default
    assert (more.thorough, fainter.thorough) == (False, True)
    assert more.config.peak_threshold == job.sfm.peak_threshold > fainter.config.peak_threshold
    assert ("all pairs compared" in more.what) == (expected == "exhaustive")


def test_further_attempts_never_keep_fewer_than_were_asked_for() -> None:
    attempts = further_attempts(job_of(30, max_features=20_000))
    assert {f.config.max_features for f in attempts} == {20_000}


def test_known_poses_are_not_sought_again() -> None:
    assert further_attempts(job_of(3, pose=(*np.eye(3).ravel().tolist(), 0.0, 0.0, 5.0))) == []


def test_the_last_attempt_does_as_that_before_without_exif_s_focal_length() -> None:
    job = job_of(12, focal=2890.0)
    more, fainter, last = further_attempts(job)
    assert more.job == fainter.job == job
    assert last.what.startswith("EXIF's focal length (250 mm, 35 mm equivalent) left aside")
    assert (last.job.exif_focal, {view.focal for view in last.job.views}) == ("", {None})
    assert (last.config, last.thorough) == (fainter.config, True)
    assert (last.below, fainter.below) == (job.sfm.min_registered, 0.95)


def test_what_a_wrong_focal_length_said_of_the_object_s_motion_is_forgotten() -> None:
    *_, fainter, last = further_attempts(job_of(12, focal=2890.0))
    before = ["the peak is lower", f"the object moves: {FROM_OBJECT}"]
    best = Answer("masked", fallbacks=before, seconds={"map": 2.0})
    again, afresh = fainter.answer(best, "fainter"), last.answer(best, "no EXIF")
    assert (again.mode, again.fallbacks) == ("masked", [*before, "fainter"])
    assert (afresh.mode, afresh.fallbacks) == ("shared", ["the peak is lower", "no EXIF"])
    assert afresh.seconds == {"map": 2.0}
    useless = "no more views registered that way; not used"
    afresh.tell("masks grown")
    again.tell("masks grown")
    assert fainter.in_vain(best, again, "fainter") == [*before, "fainter", "masks grown", useless]
    assert last.in_vain(best, afresh, "no EXIF") == [*before, "no EXIF", useless]
