"""Nothing that a training starts from knows a held-out photo, once poses are held fixed.

Test photos are replaced by others, with what a network would say of them, and the line is run again
from photos to starting splats. Poses come with the capture: where they are found, it is from all
photos together (docs/protocol.md).
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops import sfm
from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.scene import PreparedCapture, Scene, Split
from mattgs_ops.capture.sparse import NO_POINT
from mattgs_ops.config import SfmConfig
from mattgs_ops.object_masks import cross_view
from mattgs_ops.segment.mask_report import MaskReport, ViewReport
from mattgs_ops.splat.photos import store_views
from mattgs_ops.splat.training.initialise import initial_splats, starting_points

Copy = Callable[..., PreparedCapture]
Inputs = dict[str, NDArray[np.generic]]
POINTS = 600  # of the visual hull: more than the box has points of its own
ITERATIONS, SIDE = 60, 120  # of the short training behind the masks: it need not be good


def read(path: Path | None) -> NDArray[np.uint8]:
    assert path is not None
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


def segmented(capture: PreparedCapture, out: Path) -> None:
    """Make up what a network says: the true mask, blurred, with a leak elsewhere in each view."""
    for name in ("masks", "soft"):
        (out / name).mkdir(parents=True)
    rows = []
    for index, view in enumerate(capture.views):
        soft = cv2.GaussianBlur(read(view.mask), (0, 0), 3)
        soft[20 + 8 * index : 40 + 8 * index, 10:60] = 220
        cv2.imwrite(str(out / "soft" / f"{view.name}.png"), soft)
        cv2.imwrite(str(out / "masks" / f"{view.name}.png"), np.where(soft > 127, 255, 0))
        rows.append(ViewReport(view.name, float((soft > 127).mean()), (), None))
    MaskReport("u2net", "none", None, tuple(rows)).save(out / "masks.json")


def planted(capture: PreparedCapture, masks: Path, split: Split) -> None:
    """Replace the photos of one split by noise, and what is said of them by a wide stripe."""
    rng = np.random.default_rng(5)
    for view in capture.views:
        if view.split != split:
            continue
        noise = rng.integers(0, 256, (view.height, view.width, 3), dtype=np.uint8)
        cv2.imwrite(str(view.photo), cv2.GaussianBlur(noise, (0, 0), 1.5))
        stripe = np.zeros((view.height, view.width), np.uint8)
        stripe[:, 30:150] = 255
        for folder in ("soft", "masks"):
            cv2.imwrite(str(masks / folder / f"{view.name}.png"), stripe)


def training_inputs(capture: PreparedCapture, masks: Path, out: Path) -> Inputs:
    """Run structure-from-motion and cross-view masks; return all that a training starts from."""
    config = SfmConfig(random_points=POINTS)
    scene = sfm.reconstruct(capture, masks / "masks", config, out / "sfm", soft=masks / "soft")
    shutil.copyfile(masks / "masks.json", out / "sfm" / "masks.json")
    scene = cross_view.agree(Scene.load(out / "sfm"), capture, out / "agree")
    assert "masks" in scene.extra["agreement"], "the views voted"
    points = scene.points()
    found: Inputs = {f"points {name}": value for name, value in vars(points).items()}
    for view in scene.registered("train"):
        found[f"photo {view.name}"], found[f"mask {view.name}"] = read(view.photo), read(view.mask)
        assert view.camera is not None
        found[f"camera {view.name}"] = view.camera.matrix
    for background in ("original", "nobg"):
        views = store_views(scene.registered("train"), background, SIDE)
        start = initial_splats(starting_points(points, views, background, 0))
        found |= {f"{background} {name}": value.numpy() for name, value in vars(start).items()}
    return found


def changed(before: Inputs, after: Inputs) -> list[str]:
    assert before.keys() == after.keys()
    return [name for name in before if not np.array_equal(before[name], after[name])]


@pytest.mark.slow
def test_other_held_out_photos_change_no_training_input(
    copied: Copy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross_view, "ITERATIONS", ITERATIONS)
    monkeypatch.setattr(cross_view, "RESOLUTION", SIDE)
    capture = copied(cameras_are="given")
    masks = tmp_path / "segmented"
    segmented(capture, masks)
    before = training_inputs(capture, masks, tmp_path / "before")
    planted(capture, masks, "test")
    after = training_inputs(capture, masks, tmp_path / "after")
    assert changed(before, after) == []
    masks_before, masks_after = (
        {view.name: read(view.mask) for view in Scene.load(tmp_path / run / "agree").views}
        for run in ("before", "after")
    )
    held_out = [view.name for view in capture.views if view.split == "test"]
    assert all((masks_before[n] != masks_after[n]).any() for n in held_out), "the plant was seen"
    planted(capture, masks, "train")
    spoilt = training_inputs(capture, masks, tmp_path / "spoilt")
    moved = [name for name in before if before[name].shape != spoilt[name].shape]
    assert {"points xyz", "nobg means"} <= set(moved), "training photos do change them"


def views_of(scene: Scene, split: Split) -> set[str]:
    return {view.photo.name for view in scene.views if view.split == split}


def test_points_come_from_training_photos_where_poses_are_found_from_all(
    box_scene: Scene,
) -> None:
    model = read_model(box_scene.folder / "sparse" / "0")
    seen = {image.name: int((image.points != NO_POINT).sum()) for image in model.images.values()}
    assert {seen[name] for name in views_of(box_scene, "test")} == {0}
    assert min(seen[name] for name in views_of(box_scene, "train")) > 100
