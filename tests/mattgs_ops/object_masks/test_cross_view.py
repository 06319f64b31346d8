"""What the stage leaves as it was, what it does about a low plate, and what it records of both."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.formats.colmap_model import write_model
from mattgs_ops.capture.masks import mask_name, read_map
from mattgs_ops.capture.scene import PreparedCapture, Scene, SparsePoints, View
from mattgs_ops.capture.sparse import SparseImage, SparseModel
from mattgs_ops.object_masks import cross_view, vote_checks, vote_variants
from mattgs_ops.object_masks.cross_view import agree
from mattgs_ops.object_masks.photo_evidence import plain_ground
from mattgs_ops.object_masks.silhouettes import iou
from mattgs_ops.segment.mask_report import MaskReport, ViewReport
from mattgs_ops.sfm.colmap.job import KEYPOINTS_FILE
from mattgs_ops.sfm.given_points import write_no_keypoints
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_CONSTANT
from mattgs_ops.splat.rasterize import render
from tests.mattgs_ops.object_masks.ball import HEIGHT, WIDTH, leaking, orbit
from tests.mattgs_ops.object_masks.splats.test_votes import BALL, made_of, scene_of_splats


def without_points(views: list[View]) -> SparseModel:
    """Return the model of views with a camera, by one lens and no points."""
    lens = orbit()[0].intrinsics
    pinhole = ColmapCamera("PINHOLE", WIDTH, HEIGHT, (lens.fx, lens.fy, lens.cx, lens.cy))
    images = {
        number: SparseImage(
            view.photo.name,
            1,
            view.camera.rotation,
            view.camera.translation,
            np.zeros((0, 2)),
            np.zeros(0, np.int64),
        )
        for number, view in enumerate(views, 1)
        if view.camera is not None
    }
    return SparseModel(
        {1: pinhole}, images, np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0)
    )


def solved(
    folder: Path,
    source: str,
    maps: list[np.ndarray],
    photos: list[np.ndarray] | None = None,
    cameras: list[Camera] | None = None,
) -> tuple[Scene, PreparedCapture]:
    """Write a scene of photos, grey unless given, with these maps as soft maps and masks."""
    for name in ("photos", "masks", "soft"):
        (folder / name).mkdir(parents=True)
    views, rows = [], []
    for index, (camera, soft) in enumerate(zip(cameras or orbit(), maps, strict=False)):
        name = f"{index}.jpg"
        photo, mask = folder / "photos" / f"{name}.png", folder / "masks" / mask_name(name)
        grey = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        cv2.imwrite(str(photo), photos[index] if photos else grey)
        cv2.imwrite(str(mask), np.where(soft >= 0.5, 255, 0).astype(np.uint8))
        cv2.imwrite(str(folder / "soft" / mask_name(name)), (soft * 255).astype(np.uint8))
        views.append(View(name, "train", WIDTH, HEIGHT, photo, mask, camera))
        rows.append(ViewReport(name, float(soft.mean()), (), None))
    none = np.zeros((0, 3))
    points = SparsePoints(
        none, none.astype(np.uint8), np.zeros(0, np.float32), np.zeros(0, np.int32)
    )
    scene = Scene("grey", folder, tuple(views), {"dropped": ["1.jpg"]})
    scene.save(points)
    write_model(without_points(views), folder / "sparse" / "0")
    MaskReport(source, "none", None, tuple(rows)).save(folder / "masks.json")
    capture = PreparedCapture("grey", folder, tuple(views), "none", "given")
    write_no_keypoints(capture, folder / KEYPOINTS_FILE)
    return scene, capture


@pytest.mark.parametrize(
    ("source", "filled", "reason"),
    [
        ("given", 6, "masks are given, nothing to vote on"),
        ("u2net", 1, "the photos' maps share no object"),
        ("u2net", 0, "the photos' maps share no object"),
    ],
)
def test_masks_stay_and_the_scene_says_why(
    tmp_path: Path, source: str, filled: int, reason: str
) -> None:
    maps = [np.zeros((HEIGHT, WIDTH), np.float32) for _ in range(6)]
    for soft in maps[:filled]:
        soft[20:40, 30:60] = 1
    scene, capture = solved(tmp_path / "in", source, maps)
    done = agree(scene, capture, tmp_path / "out")
    agreement = dict(done.extra["agreement"])
    outlines = agreement.pop("shared_outlines")
    assert (outlines is None) is (filled < 2), "one mask alone contradicts nothing"
    untested: dict[str, Any] = {"share": None, "contradict": []}  # there are no matches
    assert agreement == {"none": reason, "shared_points": untested}
    assert done.dropped == ("1.jpg",)
    for view in done.views:
        before = tmp_path / "in" / "masks" / mask_name(view.name)
        assert view.mask is not None
        assert view.mask.read_bytes() == before.read_bytes()
    assert Scene.load(tmp_path / "out").extra == done.extra


def painted(colours: np.ndarray, splats: Splats) -> list[np.ndarray]:
    """Show splats with colours [N, 3] in [0, 1] to every camera, as floats [H, W, 3]."""
    splats.sh_dc = torch.from_numpy(((colours - 0.5) / SH_CONSTANT).astype(np.float32))
    black = (0.0, 0.0, 0.0)
    return [render(splats, camera, black, sh_degree=0).image.numpy() for camera in orbit()]


@pytest.mark.parametrize(("plate", "votes_used"), [(True, True), (True, False), (False, True)])
def test_the_ground_is_cut_unless_that_goes_through_a_plate_of_the_object(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plate: bool, votes_used: bool
) -> None:
    """A ball on a desk, on a low plate or in a shadow of that size. Maps take either along.

    Splats of an even plate lie at any height in it, so that a cut leaves it in shreds. The desk has
    all colours, so that none tells it from the ball. Votes that are not used correct maps by
    what they are without the cut, too.
    """
    means = scene_of_splats().means.numpy()
    distance = np.linalg.norm(means[:, :2], axis=1)
    disc = (np.arange(len(means)) >= BALL) & (distance < 0.9)
    heights = np.random.default_rng(1).uniform(0, 0.06, len(means))
    means[disc, 2] = heights[disc] if plate else 0.0
    splats = made_of(means, np.full(len(means), 0.025))
    in_maps = (np.arange(len(means)) < BALL) | disc
    speckles = np.random.default_rng(0).uniform(0.0, 0.9, (len(means), 3))
    shade = np.where(disc, np.clip(distance / 0.9, 0.3, 1), 1)[:, None]
    colours = np.where(disc[:, None], [0.1, 0.2, 0.7], speckles) if plate else speckles * shade
    colours[:BALL] = [0.8, 0.1, 0.1]
    photos = [
        np.rint(photo.clip(0, 1) * 255).astype(np.uint8) for photo in painted(colours, splats)
    ]
    truths = [
        shown[..., 0]
        for shown in painted((in_maps if plate else in_maps & ~disc)[:, None].repeat(3, 1), splats)
    ]
    maps = [shown[..., 0].clip(0, 1) for shown in painted(in_maps[:, None].repeat(3, 1), splats)]
    scene, capture = solved(tmp_path / "in", "u2net", maps, photos)
    monkeypatch.setattr(cross_view, "train_surfaces", lambda *_args, **_settings: splats)
    if not votes_used:
        monkeypatch.setattr(vote_checks, "_why_not_votes", lambda *_: "not used")
    found = agree(scene, capture, tmp_path / "out")
    assert not found.extra["agreement"]["plain_ground"]["used"]
    assert found.extra["agreement"]["ground_share"] > 0.5
    used = "both" if plate else "votes"  # without the cut they are as good as the maps
    assert found.extra["agreement"]["masks"] == (used if votes_used else "maps")
    assert found.extra["agreement"]["ground_cut"] != plate
    scores = [
        iou(read_map(view.mask) > 0, shown >= 0.5)
        for view, shown in zip(found.views, truths, strict=True)
        if view.mask is not None
    ]
    assert np.mean(scores) > 0.85, scores


def test_a_network_that_is_surely_better_than_the_mean_makes_the_masks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A red ball on a speckled desk; the mean takes along a patch, elsewhere in every view."""
    splats = scene_of_splats()
    ball = np.arange(len(splats.means)) < BALL
    speckles = np.random.default_rng(0).uniform(0.0, 0.9, (len(ball), 3))
    colours = np.where(ball[:, None], [0.8, 0.1, 0.1], speckles)
    photos = [
        np.rint(photo.clip(0, 1) * 255).astype(np.uint8) for photo in painted(colours, splats)
    ]
    right = [shown[..., 0].clip(0, 1) for shown in painted(ball[:, None].repeat(3, 1), splats)]
    wrong = leaking(right)
    scene, capture = solved(tmp_path / "in", "u2net", wrong, photos)
    for folder, maps in (("1", wrong), ("2", right)):
        (scene.folder / "soft" / folder).mkdir()
        for view, soft in zip(scene.views, maps, strict=True):
            path = scene.folder / "soft" / folder / mask_name(view.name)
            cv2.imwrite(str(path), (soft * 255).astype(np.uint8))
    monkeypatch.setattr(cross_view, "train_surfaces", lambda *_args, **_settings: splats)
    found = agree(scene, capture, tmp_path / "out")
    assert found.extra["agreement"]["network"] == 2
    mean, first, second = found.extra["agreement"]["networks"]
    assert mean == first < second
    assert not (tmp_path / "out" / "soft" / "1").exists()
    scores = [
        iou(read_map(view.mask) > 0, shown >= 0.5)
        for view, shown in zip(found.views, right, strict=True)
        if view.mask is not None
    ]
    assert np.mean(scores) > 0.9, scores


@pytest.mark.parametrize(("invented", "sure"), [(True, True), (True, False), (False, True)])
def test_half_of_the_votes_is_needed_where_that_fits_maps_and_edges_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invented: bool, sure: bool
) -> None:
    """A ball on rolling grey ground, a disc of which four of ten maps take along; or right maps.

    Where no test is sure, half of the votes still passes against the maps, and a quarter does not.
    """
    if not sure:
        monkeypatch.setattr(vote_variants, "surely_larger", lambda *_: False)
    means = scene_of_splats().means.numpy()
    ground = np.arange(len(means)) >= BALL
    if invented:
        means[ground, 2] += 0.2 * np.sin(4 * means[ground, 0]) * np.sin(4 * means[ground, 1])
    disc = ground & (np.linalg.norm(means[:, :2], axis=1) < 0.9)
    splats = made_of(means, np.full(len(means), 0.02))
    colours = np.where(~ground[:, None], [0.8, 0.1, 0.1], [0.5, 0.5, 0.5])
    photos = [
        np.rint(photo.clip(0, 1) * 255).astype(np.uint8) for photo in painted(colours, splats)
    ]
    truths = [shown[..., 0].clip(0, 1) for shown in painted(~ground[:, None].repeat(3, 1), splats)]
    both = painted((~ground | disc)[:, None].repeat(3, 1), splats)
    maps = [
        shown[..., 0].clip(0, 1) if invented and index % 5 in (0, 2) else truth
        for index, (shown, truth) in enumerate(zip(both, truths, strict=True))
    ]
    scene, capture = solved(tmp_path / "in", "u2net", maps, photos)
    monkeypatch.setattr(cross_view, "train_surfaces", lambda *_args, **_settings: splats)
    # grey ground alone would correct the maps; here votes alone do
    monkeypatch.setattr(plain_ground, "LARGEST_OVERLAP", -1.0)
    found = agree(scene, capture, tmp_path / "out")
    assert not found.extra["agreement"]["plain_ground"]["used"]
    assert found.extra["agreement"]["level"] == 0.5
    assert found.extra["agreement"]["half_needed"] is invented
    scores = [
        iou(read_map(view.mask) > 0, shown >= 0.5)
        for view, shown in zip(found.views, truths, strict=True)
        if view.mask is not None
    ]
    assert np.mean(scores) > 0.85, scores
