"""What the stage leaves as it was, and what it says of it; masks by votes are tested next door."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.masks import mask_name
from mattgs_ops.capture.scene import PreparedCapture, Scene, SparsePoints, View
from mattgs_ops.object_masks.cross_view import agree
from mattgs_ops.segment.mask_report import MaskReport, ViewReport
from tests.mattgs_ops.object_masks.ball import HEIGHT, WIDTH, orbit


def solved(folder: Path, source: str, maps: list[np.ndarray]) -> tuple[Scene, PreparedCapture]:
    """Write a scene of grey photos with these maps as soft maps and masks."""
    for name in ("photos", "masks", "soft"):
        (folder / name).mkdir(parents=True)
    views, rows = [], []
    for index, (camera, soft) in enumerate(zip(orbit(), maps, strict=False)):
        name = f"{index}.jpg"
        photo, mask = folder / "photos" / f"{name}.png", folder / "masks" / mask_name(name)
        cv2.imwrite(str(photo), np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
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
    MaskReport(source, "none", None, tuple(rows)).save(folder / "masks.json")
    return scene, PreparedCapture("grey", folder, tuple(views), "none", "given")


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
    assert done.extra["agreement"] == {"none": reason}
    assert done.dropped == ("1.jpg",)
    for view in done.views:
        before = tmp_path / "in" / "masks" / mask_name(view.name)
        assert view.mask is not None
        assert view.mask.read_bytes() == before.read_bytes()
    assert Scene.load(tmp_path / "out").extra == done.extra
