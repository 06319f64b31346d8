"""Specification of reconstruction as a whole, on a small capture with known cameras."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops import sfm
from mattgs_ops.capture import sparse
from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.scene import PreparedCapture, Scene, View
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import StageError
from mattgs_ops.progress import Progress
from mattgs_ops.sfm import figure, pipeline
from mattgs_ops.sfm.colmap.job import Answer, Job
from mattgs_ops.sfm.colmap.process import run_worker
from tests.mattgs_ops.conftest import photographed

Copy = Callable[..., PreparedCapture]
CONFIG = SfmConfig()


def masks_of(capture: PreparedCapture) -> Path:
    return capture.folder / "masks"


def read(path: Path | None) -> NDArray[np.uint8]:
    assert path is not None
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


def shares_in_truth(scene: Scene, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each point the share of views in whose mask it projects."""
    hits = [
        sparse.inside(read(view.mask), *view.camera.project(xyz))
        for view in scene.views
        if view.camera is not None
    ]
    return np.mean(hits, axis=0)


def test_every_view_is_registered_close_to_where_it_was(box_scene: Scene) -> None:
    extra = box_scene.extra
    assert (extra["registered"], extra["views"], extra["missing"]) == (9, 9, [])
    assert (extra["mode"], extra["poses"], extra["fallbacks"]) == ("shared", "estimated", [])
    error = extra["pose_error"]
    assert error["views"] == 9
    assert error["position_max"] < 0.01
    assert abs(error["focal"]) < 0.02
    assert extra["reprojection_error"] < 0.5


def test_poses_are_exact_on_most_textures(box_scene: Scene, tmp_path: Path) -> None:
    # nine small photos from an arc of 80 degrees fix its tilt badly: one texture may be off
    scenes = [box_scene]
    for seed in (1, 2, 3):
        capture = photographed(tmp_path / f"{seed}", seed)
        scenes.append(sfm.reconstruct(capture, masks_of(capture), CONFIG, tmp_path / f"out-{seed}"))
    errors = [scene.extra["pose_error"] for scene in scenes]
    assert [error["views"] for error in errors] == [9] * 4
    assert np.median([error["rotation_deg_max"] for error in errors]) < 0.5
    assert max(error["rotation_deg_max"] for error in errors) < 1.0
    assert max(error["position_max"] for error in errors) < 0.01


def test_object_points_lie_on_the_object_and_the_others_beside_it(box_scene: Scene) -> None:
    points = box_scene.points()
    mine = sparse.on_object(points)
    assert len(mine.xyz) == box_scene.extra["object_points"] > 100
    assert len(points.xyz) == box_scene.extra["points"] > 1.5 * len(mine.xyz)
    # harder than the vote: views that do not see a point must show the box there, too
    assert np.mean(shares_in_truth(box_scene, mine.xyz) >= 0.8) > 0.95
    assert (mine.object_share >= np.float32(0.8)).all()
    assert (points.views_seen >= 2).all()


def test_the_scene_reads_back_with_all_that_later_stages_need(box_scene: Scene) -> None:
    scene = Scene.load(box_scene.folder)
    assert [v.name for v in scene.views] == [f"{k:04d}.jpg" for k in range(9)]
    assert [v.split for v in scene.views] == ["test"] + ["train"] * 7 + ["test"]
    for view in scene.views:
        assert view.camera is not None
        i = view.camera.intrinsics
        assert (i.width, i.height) == (view.width, view.height) == (240, 180)
        assert read(view.photo).shape == (180, 240, 3)
        assert set(np.unique(read(view.mask))) == {0, 255}
    model = read_model(scene.folder / "sparse" / "0")
    assert [c.model for c in model.cameras.values()] == ["PINHOLE"]
    assert len(model.xyz) == len(scene.points().xyz)
    for image in model.images.values():  # COLMAP's names are files beside the model
        assert (scene.folder / "photos" / image.name).is_file()
    kept = {path.name for path in scene.folder.iterdir()}
    assert {"sfm.log", "keypoints.npz", "points.ply", "sfm.png"} < kept
    assert "sfm-workspace" not in kept


def test_counts_with_and_without_masks_are_reported(box_scene: Scene) -> None:
    extra, keypoints = box_scene.extra, figure.read_keypoints(box_scene.folder)
    assert extra["keypoints"]["original"] == sum(len(xy) for xy, _ in keypoints.values())
    assert extra["keypoints"]["masked"] == sum(int(i.sum()) for _, i in keypoints.values())
    assert extra["keypoint_reduction"] == pytest.approx(
        1 - extra["keypoints"]["masked"] / extra["keypoints"]["original"]
    )
    assert 0 < extra["matches"]["masked guided"] < extra["matches"]["whole"]
    assert extra["pairs"]["whole"] == 36
    for key in ("seconds", "cpu_seconds"):
        assert set(extra[key]) == {"extract", "match", "map", "guide", "triangulate"}


def test_the_same_input_gives_the_same_bits_with_any_number_of_threads(
    box_capture: PreparedCapture, box_scene: Scene, tmp_path: Path
) -> None:
    progress: list[tuple[int, int, str]] = []
    again = sfm.reconstruct(
        box_capture,
        masks_of(box_capture),
        CONFIG,
        tmp_path,
        threads=2,
        progress=lambda *told: progress.append(told),
    )
    for name in ("cameras.bin", "images.bin", "points3D.bin"):
        first, second = (s.folder / "sparse" / "0" / name for s in (box_scene, again))
        assert first.read_bytes() == second.read_bytes(), name
    assert (tmp_path / "points.ply").read_bytes() == (box_scene.folder / "points.ply").read_bytes()
    assert again.views[3].camera is not None
    assert box_scene.views[3].camera is not None
    assert np.array_equal(again.views[3].camera.matrix, box_scene.views[3].camera.matrix)
    done = [d for d, _, _ in progress]
    assert done == sorted(done)
    assert {t for _, t, _ in progress} == {1000}
    assert done[-1] == 1000
    for words in ("key points in 0004.jpg", "pairs match", "9 of 9 views registered"):
        assert any(words in note for _, _, note in progress), words


def test_masked_mode_sees_nothing_but_the_object(
    box_capture: PreparedCapture, tmp_path: Path
) -> None:
    config = SfmConfig(mode="masked")
    scene = sfm.reconstruct(box_capture, masks_of(box_capture), config, tmp_path)
    assert scene.extra["mode"] == "masked"
    assert scene.extra["registered"] >= 8
    assert set(scene.extra["matches"]) == {"masked"}
    model = read_model(scene.folder / "sparse" / "0")
    masks = {view.photo.name: read(view.mask) for view in scene.views}
    for image in model.images.values():  # undistortion moves the edge by parts of a pixel
        assert sparse.inside(masks[image.name], image.xy, np.ones(len(image.xy))).mean() > 0.98


def test_given_poses_are_kept_to_the_last_bit(copied: Copy, tmp_path: Path) -> None:
    capture = copied(cameras_are="given")
    views = (replace(capture.views[0], camera=None), *capture.views[1:])
    capture = replace(capture, views=views)
    scene = sfm.reconstruct(capture, masks_of(capture), CONFIG, tmp_path / "out")
    extra = scene.extra
    assert (extra["poses"], extra["pose_error"], extra["registered"]) == ("given", None, 8)
    assert [m["name"] for m in extra["missing"]] == ["0000.jpg"]
    assert "map" not in extra["seconds"]
    for before, after in zip(capture.views[1:], scene.views[1:], strict=True):
        assert before.camera is not None
        assert after.camera is not None
        assert after.camera.intrinsics == before.camera.intrinsics
        assert np.allclose(after.camera.matrix, before.camera.matrix, atol=1e-12)
    xyz = sparse.on_object(scene.points()).xyz
    assert len(xyz) > 100
    # in the world of the given poses, where the box is known
    near = np.abs(xyz - [0, 0, 0.35]) <= np.array([0.5, 0.4, 0.35]) + 0.05
    # votes of the views that see a point cannot tell a wrong depth along their common ray
    assert near.all(axis=1).mean() > 0.9


def test_more_views_may_be_held_out_than_trained_on(copied: Copy, tmp_path: Path) -> None:
    """As in the NeRF scenes: 100 photos to train on, 200 held out, all poses given."""
    capture = copied(cameras_are="given")
    views = [
        replace(v, split="train" if 2 <= k < 6 else "test") for k, v in enumerate(capture.views)
    ]
    capture = replace(capture, views=tuple(views))
    scene = sfm.reconstruct(capture, masks_of(capture), CONFIG, tmp_path / "out")
    assert (scene.extra["registered"], scene.extra["missing"]) == (9, [])
    assert set(read_model(scene.folder / "sparse" / "0").images) == set(range(1, 10))


def test_given_cameras_may_be_ignored_but_their_intrinsics_hold(
    copied: Copy, tmp_path: Path
) -> None:
    capture = copied(cameras_are="given")
    config = SfmConfig(poses="estimate", mapper="global", mode="original")
    scene = sfm.reconstruct(capture, masks_of(capture), config, tmp_path / "out")
    assert scene.extra["poses"] == "estimated"
    assert scene.extra["registered"] == 9
    assert scene.extra["pose_error"]["focal"] == 0
    assert scene.extra["pose_error"]["rotation_deg_max"] < 1


def spoil(view: View, rng: np.random.Generator) -> None:
    noise = rng.integers(0, 256, (view.height, view.width, 3), dtype=np.uint8)
    cv2.imwrite(str(view.photo), cv2.GaussianBlur(noise, (0, 0), 2))


def test_a_view_that_cannot_be_registered_is_listed_and_keeps_its_place(
    copied: Copy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers: list[Answer] = []

    def once(job: Job, log: Path, progress: Progress) -> Answer:  # both times the same is found
        if not answers:
            answers.append(run_worker(job, log, progress))
        return answers[0]

    monkeypatch.setattr(pipeline, "run_worker", once)
    capture = copied()
    spoil(capture.views[4], np.random.default_rng(0))
    scene = sfm.reconstruct(capture, masks_of(capture), CONFIG, tmp_path / "out")
    (missing,) = scene.extra["missing"]
    assert missing["name"] == "0004.jpg"
    assert missing["keypoints"] >= missing["masked"] > 0
    assert scene.extra["registered_share"] == pytest.approx(8 / 9)
    assert [v.name for v in scene.views if v.camera is None] == ["0004.jpg"]
    assert scene.views[4].photo.is_file()
    strict = SfmConfig(min_registered=0.9)
    with pytest.raises(
        StageError, match=r"(?s)8 of 9 views \(89%\).*0004\.jpg is matched by no other"
    ):
        sfm.reconstruct(capture, masks_of(capture), strict, tmp_path / "strict")


def test_views_of_nothing_in_common_are_a_stage_error(copied: Copy, tmp_path: Path) -> None:
    capture = copied()
    rng = np.random.default_rng(1)
    for view in capture.views:
        spoil(view, rng)
    with pytest.raises(StageError, match="none of 36 pairs of views shows the same scene"):
        sfm.reconstruct(capture, masks_of(capture), CONFIG, tmp_path / "out")


def test_with_given_poses_points_are_drawn_at_random_where_nothing_matches(
    copied: Copy, tmp_path: Path
) -> None:
    capture = copied(cameras_are="given")
    rng = np.random.default_rng(1)
    for view in capture.views:
        spoil(view, rng)
    config = SfmConfig(random_points=300)
    scene = sfm.reconstruct(capture, masks_of(capture), config, tmp_path / "out")
    assert scene.extra["registered"] == 9
    assert "300 random ones added inside the masks' visual hull" in scene.extra["fallbacks"][-1]
    assert scene.extra["points_source"].endswith("random in the visual hull")
    assert len(scene.points().xyz) == scene.extra["triangulated"] + 300
    assert Scene.load(tmp_path / "out").registered("train")


def test_few_registered_views_lead_to_further_attempts_with_more_key_points(
    copied: Copy, tmp_path: Path
) -> None:
    capture = copied()
    for view in capture.views:  # half the size: too few key points unless sought at twice the size
        small = cv2.resize(read(view.photo), (120, 90), interpolation=cv2.INTER_AREA)
        cut = cv2.resize(read(view.mask), (120, 90), interpolation=cv2.INTER_NEAREST)
        cv2.imwrite(str(view.photo), small)
        cv2.imwrite(str(masks_of(capture) / f"{view.name}.png"), cut)
    views = tuple(replace(view, width=120, height=90) for view in capture.views)
    capture = replace(capture, views=views, cameras_are="none")
    scene = sfm.reconstruct(capture, masks_of(capture), SfmConfig(upsample=False), tmp_path / "out")
    steps = [s.split(": ")[1] for s in scene.extra["fallbacks"] if "views registered" in s]
    assert steps == [
        "up to 8,192 key points kept, all pairs compared",
        "fainter key points of affine shapes sought by COLMAP's SIFT, up to 8,192 kept",
    ]
    assert scene.extra["registered"] == 9


def test_an_object_without_texture_falls_back_in_stated_steps(copied: Copy, tmp_path: Path) -> None:
    capture = copied()
    for view in capture.views:  # paint the object flat: only its surroundings have key points
        photo, mask = read(view.photo).copy(), read(view.mask)
        photo[mask > 0] = (40, 90, 160)
        cv2.imwrite(str(view.photo), photo)
    config = SfmConfig(mode="masked", random_points=500)
    scene = sfm.reconstruct(capture, masks_of(capture), config, tmp_path / "out")
    steps = scene.extra["fallbacks"]
    assert "SIFT peak threshold lowered" in steps[0]
    assert "masks grown by 2%" in steps[1]
    assert "mode shared instead of masked" in steps[2]
    assert "500 random ones added inside the masks' visual hull" in steps[-1]
    assert (scene.extra["mode"], scene.extra["registered"]) == ("shared", 9)
    assert scene.extra["points_source"] == "triangulated and random in the visual hull"
    mine = sparse.on_object(scene.points())
    assert len(mine.xyz) >= 500
    assert np.abs(mine.rgb[-500:].mean(axis=0) - [160, 90, 40]).max() < 25  # the paint, as RGB
    assert len(scene.points().xyz) == scene.extra["points"] == scene.extra["triangulated"] + 500
