"""From splats to stored renders to scores, on a small scene with known splats."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.score.evaluate import RenderedViews, render_views, score
from mattgs_ops.score.metric_table import METRICS
from mattgs_ops.score.metrics import PSNR_CEILING
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.rasterize import render
from tests.mattgs_ops.score.conftest import (
    HEIGHT,
    NOBG,
    ORIGINAL,
    WHITE,
    WIDTH,
    ball,
    changed,
    picture,
)


def stored(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.array(image)


def test_the_right_splats_score_perfectly(scene: Scene, ply: Path, tmp_path: Path) -> None:
    render_views(scene, ply, ORIGINAL, WIDTH, tmp_path / "out")
    metrics = score(tmp_path / "out")["metrics"]
    for name in ("psnr", "mask_psnr", "train_psnr"):
        assert metrics[name] == PSNR_CEILING
    assert metrics["ssim"] == metrics["mask_ssim"] == pytest.approx(1)
    assert metrics["l1"] == metrics["loss"] == metrics["paper_loss"] == pytest.approx(0, abs=1e-12)


def test_worse_splats_score_worse(scene: Scene, tmp_path: Path) -> None:
    worse = ball()
    worse.means[:, 0] += 0.05
    write_ply(worse, tmp_path / "worse.ply")
    render_views(scene, tmp_path / "worse.ply", ORIGINAL, WIDTH, tmp_path / "out")
    metrics = score(tmp_path / "out")["metrics"]
    assert 15 < metrics["mask_psnr"] < metrics["psnr"] < 40
    assert metrics["ssim"] < 0.99
    assert 0 < metrics["paper_l1"] < metrics["l1"]


def test_what_is_stored_is_what_is_scored(scene: Scene, ply: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    rendered = render_views(scene, ply, ORIGINAL, WIDTH, out)
    assert RenderedViews.load(out) == rendered
    for kind in ("renders", "truth", "masks"):
        assert [p.name for p in sorted((out / kind / "test").iterdir())] == [
            "00.jpg.png",
            "08.jpg.png",
        ]
        assert len(list((out / kind / "train").iterdir())) == 7
    before = score(out)
    path = out / "renders" / "test" / "08.jpg.png"
    pixels = stored(path)
    pixels[:8] = 255 - pixels[:8]
    Image.fromarray(pixels).save(path)
    after = score(out)
    assert after["per_view"][0] == before["per_view"][0]
    assert after["per_view"][1]["psnr"] < before["per_view"][1]["psnr"]
    assert after["digests"]["renders"] != before["digests"]["renders"]
    assert after["digests"]["truth"] == before["digests"]["truth"]
    assert json.loads((out / "evaluation.json").read_text()) == after


def test_a_pixel_is_in_the_mask_from_half_of_its_area_on(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    render_views(scene, ply, ORIGINAL, WIDTH, out)
    left = np.arange(WIDTH) < WIDTH // 2
    mask = np.tile(np.where(left, 128, 127).astype(np.uint8), (HEIGHT, 1))
    Image.fromarray(mask).save(out / "masks" / "test" / "00.jpg.png")
    path = out / "renders" / "test" / "00.jpg.png"
    right = stored(path)

    def scores(wrong: np.ndarray) -> dict[str, float]:
        Image.fromarray(np.where(wrong[:, None], 255 - right, right)).save(path)
        view: dict[str, float] = score(out)["per_view"][0]
        return view

    outside = scores(~left)
    assert outside["mask_l1"] == 0 < outside["l1"]
    assert scores(left)["mask_l1"] > 0


def decisive(scene: Scene, ply: Path, condition: Condition, out: Path) -> dict[str, str]:
    render_views(scene, ply, condition, WIDTH, out)
    digests = score(out)["digests"]
    return {name: digests[name] for name in ("truth", "masks")}


def test_masks_and_truth_have_digests_of_their_pixels(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    """Masks two pixels larger show, in the cut-out's truth too; another compression does not."""
    views = scene.registered("test")
    before = [decisive(scene, ply, c, tmp_path / f"{c} 1") for c in (ORIGINAL, NOBG)]
    for view in scene.views:
        Image.fromarray(stored(view.photo)).save(view.photo, compress_level=1)
    assert [decisive(scene, ply, c, tmp_path / f"{c} 2") for c in (ORIGINAL, NOBG)] == before
    for view in views:
        assert view.mask is not None
        mask = cv2.dilate(stored(view.mask), np.ones((5, 5), np.uint8))
        Image.fromarray(mask).save(view.mask)
    after = [decisive(scene, ply, c, tmp_path / f"{c} 3") for c in (ORIGINAL, NOBG)]
    assert after[0]["truth"] == before[0]["truth"]
    assert after[0]["masks"] != before[0]["masks"]
    assert after[1]["truth"] != before[1]["truth"]


def covered(scene: Scene, folder: Path) -> Scene:
    """Give every view an exact mask: the ball's opacity, at 8 bits."""
    folder.mkdir()
    views = []
    for view in scene.views:
        assert view.camera is not None
        alpha = render(ball(), view.camera, WHITE).alpha.numpy()
        path = folder / f"{view.name}.png"
        Image.fromarray(np.rint(alpha * 255).astype(np.uint8)).save(path)
        views.append(replace(view, coverage=path))
    return replace(scene, views=tuple(views))


def test_exact_masks_score_and_the_pipelines_do_not(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    """Whatever the pipeline's masks are, scores, truth and masks are the same; rows say whose."""
    exact = covered(scene, tmp_path / "coverage")
    render_views(exact, ply, NOBG, WIDTH, tmp_path / "one")
    before = score(tmp_path / "one")
    for view in scene.views:
        assert view.mask is not None
        Image.fromarray(np.zeros((HEIGHT, WIDTH), np.uint8)).save(view.mask)
    lost = replace(exact, extra={"dropped": [view.name for view in scene.views]})
    render_views(lost, ply, NOBG, WIDTH, tmp_path / "two")
    after = score(tmp_path / "two")
    held_out = [row for row in before["per_view"] if row["split"] == "test"]
    assert after["per_view"] == held_out  # nothing is trained on where nothing was found
    assert after["digests"]["masks"] == before["digests"]["masks"]
    assert (before["masks"], after["masks"]) == ("exact", "exact")
    render_views(scene, ply, ORIGINAL, WIDTH, tmp_path / "three")
    assert score(tmp_path / "three")["masks"] == "pipeline"


def test_the_truth_of_nobg_is_mixed_by_exact_coverage(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    """A pixel that is a third object is a third photo and two thirds white."""
    view = scene.views[0]
    Image.fromarray(np.zeros((HEIGHT, WIDTH, 3), np.uint8)).save(view.photo)
    share = np.zeros((HEIGHT, WIDTH), np.uint8)
    share[:, :20], share[:, 20] = 255, 85
    Image.fromarray(share).save(tmp_path / "share.png")
    known = changed(scene, 0, coverage=tmp_path / "share.png")
    render_views(known, ply, NOBG, WIDTH, tmp_path / "out")
    truth = stored(tmp_path / "out" / "truth" / "test" / "00.jpg.png")
    assert truth[5, 18:23, 0].tolist() == [0, 0, 170, 255, 255]
    assert stored(tmp_path / "out" / "masks" / "test" / "00.jpg.png")[5, 20] == 85
    assert score(tmp_path / "out")["masks"] == "both"  # the other test view has none
    # a photo with alpha lies on white already, and is its own truth
    cut = changed(known, 0, cut_out=True)
    render_views(cut, ply, NOBG, WIDTH, tmp_path / "cut")
    assert stored(tmp_path / "cut" / "truth" / "test" / "00.jpg.png").max() == 0


def test_means_are_means_of_the_views_values(scene: Scene, tmp_path: Path) -> None:
    worse = ball()
    worse.means[:, 1] += 0.04
    write_ply(worse, tmp_path / "worse.ply")
    render_views(scene, tmp_path / "worse.ply", NOBG, WIDTH, tmp_path / "out")
    result = score(tmp_path / "out")
    assert [(row["view"], row["split"]) for row in result["per_view"]][:3] == [
        ("00.jpg", "test"),
        ("08.jpg", "test"),
        ("01.jpg", "train"),
    ]
    for split, prefix, count in (("test", "", 2), ("train", "train_", 7)):
        values = [row["psnr"] for row in result["per_view"] if row["split"] == split]
        assert result["metrics"][f"{prefix}psnr"] == pytest.approx(sum(values) / count)
        assert result["counts"][f"{prefix}psnr"] == count
    assert set(result["metrics"]) <= set(METRICS)
    assert set(result["versions"]) == set(result["metrics"])


def test_each_condition_is_compared_with_its_own_truth(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    """Over a dark desk ``original`` keeps the desk, ``nobg`` stands on white."""
    for view in scene.views:
        assert view.camera is not None
        dark = render(ball(), view.camera, (0.1, 0.1, 0.1))
        Image.fromarray(picture(dark.image)).save(view.photo)
    scores = {}
    for condition in (ORIGINAL, NOBG):
        out = tmp_path / str(condition)
        shown = render_views(scene, ply, condition, WIDTH, out, background=(0.1, 0.1, 0.1))
        corner = stored(out / "truth" / "test" / "00.jpg.png")[0, 0]
        assert corner.tolist() == ([255] * 3 if condition is NOBG else [26] * 3)
        assert shown.background == (WHITE if condition is NOBG else (0.1, 0.1, 0.1))
        scores[str(condition)] = score(out)["metrics"]
    assert scores["original-3dgs"]["psnr"] == PSNR_CEILING
    assert scores["nobg-ours"]["psnr"] > 15  # the ball's soft rim is cut by the binary mask


def test_a_test_view_without_a_camera_is_a_stated_failure(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    lost = changed(scene, 8, camera=None)
    render_views(lost, ply, ORIGINAL, WIDTH, tmp_path / "out")
    result = score(tmp_path / "out")
    assert result["missing"] == ["08.jpg"]
    assert result["metrics"]["missing_views"] == 1
    assert result["metrics"]["test_views"] == 1
    with pytest.raises(StageError, match="expected test views with a camera, found none of 2"):
        render_views(changed(lost, 0, camera=None), ply, ORIGINAL, WIDTH, tmp_path / "none")


def test_views_without_masks_have_no_scores_in_them(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    bare = replace(scene, views=tuple(replace(view, mask=None) for view in scene.views))
    render_views(bare, ply, ORIGINAL, WIDTH, tmp_path / "out")
    result = score(tmp_path / "out")
    assert "mask_psnr" not in result["metrics"]
    assert result["per_view"][0]["mask_psnr"] is None
    assert "psnr" in result["metrics"]


def test_some_training_views_only_and_that_is_stated(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    render_views(scene, ply, ORIGINAL, WIDTH, tmp_path / "out", train_every=3)
    result = score(tmp_path / "out")
    names = [row["view"] for row in result["per_view"] if row["split"] == "train"]
    assert names == ["01.jpg", "04.jpg", "07.jpg"]
    assert result["train_every"] == 3
    assert result["counts"]["train_psnr"] == 3


def test_size_is_of_the_file_in_millions_of_bytes(scene: Scene, ply: Path, tmp_path: Path) -> None:
    render_views(scene, ply, ORIGINAL, WIDTH, tmp_path / "out")
    metrics = score(tmp_path / "out")["metrics"]
    assert metrics["size_mb"] == ply.stat().st_size / 1_000_000
    assert metrics["splats"] == 60


def test_a_smaller_resolution_makes_smaller_pictures(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    render_views(scene, ply, ORIGINAL, 20, tmp_path / "out")
    for kind in ("renders", "truth", "masks"):
        small = stored(tmp_path / "out" / kind / "test" / "00.jpg.png")
        assert small.shape[:2] == (16, 20)
    assert score(tmp_path / "out")["metrics"]["psnr"] > 20


def test_progress_names_each_view(scene: Scene, ply: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int, str]] = []
    render_views(
        scene, ply, ORIGINAL, WIDTH, tmp_path / "out", progress=lambda *args: seen.append(args)
    )
    assert seen[0] == (1, 9, "00.jpg rendered")
    assert seen[-1][:2] == (9, 9)


def test_what_is_missing_or_does_not_fit_is_named(scene: Scene, ply: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"views\.json: expected the list of rendered views"):
        score(out)
    render_views(scene, ply, ORIGINAL, WIDTH, out)
    path = out / "renders" / "test" / "08.jpg.png"
    Image.fromarray(stored(path)[:16, :20]).save(path)
    with pytest.raises(InputError, match=r"render of 08\.jpg is 20 x 16, its truth 40 x 32"):
        score(out)
    path.unlink()
    with pytest.raises(InputError, match=r"08\.jpg\.png: expected a stored render"):
        score(out)
