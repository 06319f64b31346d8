"""Small structures: where they are at another size, and in which views they are scored."""

from pathlib import Path

import numpy as np
from PIL import Image

from mattgs_ops.capture.scene import Scene
from mattgs_ops.score.evaluate import render_views, score
from tests.mattgs_ops.score.conftest import HEIGHT, ORIGINAL, WIDTH, changed


def test_details_are_shrunk_with_the_photo_so_that_thin_ones_stay(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[:, 20] = 2  # half a pixel wide at half the size
    ids[0, 0] = 1  # a quarter of one
    Image.fromarray(ids).save(tmp_path / "ids.png")
    known = changed(scene, 0, ids=tmp_path / "ids.png")
    render_views(known, ply, ORIGINAL, WIDTH // 2, tmp_path / "out")
    with Image.open(tmp_path / "out" / "details" / "test" / "00.jpg.png") as image:
        details = np.array(image)
    rows, columns = np.nonzero(details)
    assert {*zip(rows.tolist(), columns.tolist(), strict=True)} == {
        (0, 0),
        *((row, 10) for row in range(HEIGHT // 2)),
    }
    result = score(tmp_path / "out")
    assert result["counts"]["detail_psnr"] == 1  # of two test views
    assert result["metrics"]["detail_psnr"] > 15


def test_details_of_training_views_are_not_scored(scene: Scene, ply: Path, tmp_path: Path) -> None:
    Image.fromarray(np.full((HEIGHT, WIDTH), 2, np.uint8)).save(tmp_path / "ids.png")
    known = scene
    for number in range(len(scene.views)):
        known = changed(known, number, ids=tmp_path / "ids.png")
    render_views(known, ply, ORIGINAL, WIDTH, tmp_path / "out")
    result = score(tmp_path / "out")
    assert result["counts"]["detail_psnr"] == 2
    assert "train_detail_psnr" not in result["metrics"]
