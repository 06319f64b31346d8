"""Haze: a cloud that is planted before a camera is found there, and nothing else is."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.scene import Scene, SparsePoints
from mattgs_ops.score.evaluate import render_views, score
from mattgs_ops.score.haze import AIR, FEWEST_POINTS, depth_of_air, haze_map
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.optimise import concatenate
from tests.mattgs_ops.score.conftest import HEIGHT, ORIGINAL, WIDTH, ball, camera

POINTS = np.random.default_rng(8).normal(size=(400, 3)) * 0.4  # on the ball, at the origin


def cloud(share: float, opacity: float, index: int = 0) -> Splats:
    """Make a wide, faint cloud on the way from a camera to the origin."""
    eye = camera(index)
    place = eye.centre * (1 - share)
    splats = Splats.zeros(40)
    spread = np.random.default_rng(9).normal(size=(40, 3)) * 0.1
    splats.means[:] = torch.from_numpy(place + spread)
    splats.log_scales[:] = float(np.log(0.1))
    splats.quaternions[:, 0] = 1
    splats.opacity_logits[:] = float(np.log(opacity / (1 - opacity)))
    return splats


def known(scene: Scene) -> Scene:
    count = len(POINTS)
    points = SparsePoints(
        POINTS, np.zeros((count, 3), np.uint8), np.ones(count, np.float32), np.full(count, 3)
    )
    np.savez(scene.folder / "points.npz", **vars(points))
    return scene


def test_air_ends_well_before_the_nearest_points() -> None:
    depth = depth_of_air(POINTS, camera(0))
    assert depth is not None
    depths = np.sort(camera(0).project(POINTS)[1])
    assert AIR * depths[0] <= depth <= AIR * depths[10]
    assert depth_of_air(np.array([[0, 0, -3.4], *POINTS]), camera(0)) == pytest.approx(depth, 0.02)
    assert depth_of_air(POINTS[:50], camera(0)) is None


LENS = camera(0).intrinsics
MIDDLE = (WIDTH / 2, HEIGHT / 2)


def points_at(pixel: tuple[float, float], depths: np.ndarray) -> np.ndarray:
    """Return points [N, 3] that a camera at the origin sees at a pixel, that deep."""
    x, y = (pixel[0] - LENS.cx) / LENS.fx, (pixel[1] - LENS.cy) / LENS.fy
    return np.outer(depths, [x, y, 1.0])


@pytest.mark.parametrize("unit", [1.0, 0.01])
@pytest.mark.parametrize(
    "pixel",
    [(-1.0, 16.0), (WIDTH + 1.0, 16.0), (20.0, -1.0), (20.0, HEIGHT + 1.0), (-1.0, -1.0)],
)
def test_points_beside_the_frame_or_behind_the_camera_say_nothing_of_its_air(
    pixel: tuple[float, float], unit: float
) -> None:
    eye = Camera(LENS, np.eye(3), np.zeros(3))
    framed = points_at(MIDDLE, unit * np.linspace(4.0, 6.0, 101))
    depth = depth_of_air(framed, eye)
    assert depth == pytest.approx(AIR * 4.02 * unit), "one in a hundred is nearer"
    beside = points_at(pixel, unit * np.linspace(0.5, 1.0, 200))
    behind = points_at(MIDDLE, unit * np.linspace(-1.0, -0.5, 200))
    assert depth_of_air(np.concatenate([framed, beside, behind]), eye) == depth
    fewest = framed[:FEWEST_POINTS]
    assert depth_of_air(np.concatenate([fewest, beside]), eye) is not None
    assert depth_of_air(np.concatenate([fewest[1:], beside, behind]), eye) is None


def test_the_object_itself_is_no_haze() -> None:
    cover = haze_map(ball(), camera(0), POINTS)
    assert cover is not None
    assert cover.shape == (HEIGHT, WIDTH)
    assert cover.max() == 0


@pytest.mark.parametrize(("opacity", "least", "most"), [(0.02, 0.02, 0.4), (0.1, 0.15, 0.95)])
def test_a_planted_cloud_is_measured_where_it_hangs(
    opacity: float, least: float, most: float
) -> None:
    splats = concatenate(ball(), cloud(0.3, opacity))
    cover = haze_map(splats, camera(0), POINTS)
    elsewhere = haze_map(splats, camera(9), POINTS)
    assert cover is not None
    assert elsewhere is not None
    assert least < cover.mean() < most
    assert elsewhere.mean() < cover.mean() / 10
    assert cover[HEIGHT // 2, WIDTH // 2] > cover[0, 0]
    beyond = haze_map(concatenate(ball(), cloud(0.7, opacity)), camera(0), POINTS)
    assert beyond is not None
    assert beyond.max() == 0  # as near to the object as its own points may be


def test_the_view_with_the_cloud_is_the_one_that_scores_say(scene: Scene, tmp_path: Path) -> None:
    write_ply(concatenate(ball(), cloud(0.3, 0.1, index=8)), tmp_path / "hazy.ply")
    render_views(known(scene), tmp_path / "hazy.ply", ORIGINAL, WIDTH, tmp_path / "out")
    clear, hazy = (row for row in score(tmp_path / "out")["per_view"] if row["split"] == "test")
    assert (clear["view"], hazy["view"]) == ("00.jpg", "08.jpg")
    assert clear["mask_haze"] < 0.1 < hazy["mask_haze"]
    assert hazy["mask_psnr"] < clear["mask_psnr"] - 3
    few = replace(scene, extra={})
    few_points: dict[str, Any] = {k: v[:50] for k, v in _arrays(scene).items()}
    np.savez(scene.folder / "points.npz", **few_points)
    render_views(few, tmp_path / "hazy.ply", ORIGINAL, WIDTH, tmp_path / "few")
    assert "haze" not in score(tmp_path / "few")["metrics"]


def _arrays(scene: Scene) -> dict[str, np.ndarray]:
    return dict(vars(scene.points()))
