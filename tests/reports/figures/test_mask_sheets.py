"""The sheet of a capture's masks says whose masks they are."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.scene import Scene, SparsePoints, View
from reports.figures import mask_sheets
from reports.figures.plots import style


def scene(folder: Path, agreement: dict[str, Any]) -> Scene:
    views = []
    for name in ("a.jpg", "b$_$.jpg"):  # no formula
        pictures = {"photos": np.full((30, 40, 3), 90), "masks": np.eye(30, 40) * 255}
        for kind, picture in pictures.items():
            (folder / kind).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / kind / f"{name}.png"), picture.astype(np.uint8))
        photo, mask = (folder / kind / f"{name}.png" for kind in ("photos", "masks"))
        views.append(View(name, "train", 40, 30, photo, mask, None))
    made = Scene("rover", folder, tuple(views), {"agreement": agreement})
    none, bytes_, numbers = np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0)
    made.save(SparsePoints(none, bytes_, numbers.astype(np.float32), numbers.astype(np.int32)))
    return made


@pytest.mark.parametrize(
    ("agreement", "says"),
    [
        ({"masks": "votes", "network": 0}, "Masks were voted on by the training views."),
        (
            {"masks": "maps", "network": 2},
            "by the training views; network 2 of the model file is used, surely better than t",
        ),
        (
            {"masks": "both"},
            "Masks are the mean of the network's and of what the training views voted.",
        ),
        ({"none": "the photos' maps share no object"}, "Masks are the network's."),
    ],
)
def test_the_caption_says_whose_masks_they_are(
    tmp_path: Path, agreement: dict[str, Any], says: str
) -> None:
    scene(tmp_path / "scene", agreement)
    row = {"capture": "rover", "artifacts": {"scene": "scene"}}
    with style():
        drawn = mask_sheets.sheet([row], "rover", tmp_path, tmp_path / "out")
    assert drawn is not None
    assert says in drawn.caption
    assert drawn.png.is_file()


def test_the_caption_lists_photos_by_flag(tmp_path: Path) -> None:
    made = scene(tmp_path, {"masks": "votes", "network": 0})
    flags = {"a": ("frame",), "b": (), "c": ("outlier", "frame")}
    caption = mask_sheets.caption_of("rover", made, 3, flags, tmp_path)
    assert caption.endswith(" Flags: frame (2): a, c; outlier (1): c.")


def test_a_title_fits_above_its_photo() -> None:
    assert mask_sheets.title("IMG_1.jpg", []) == "IMG_1.jpg"
    assert mask_sheets.title("IMG_1.jpg", ["frame", "no camera"]) == "IMG_1.jpg\nframe, no camera"
    long = mask_sheets.title("left__DSC_0001_copy_of_copy.jpg", [])
    assert len(long) == mask_sheets.LONGEST_NAME
    assert long == "left__DSC_000…y_of_copy.jpg"


def test_ground_is_dimmed_and_the_object_is_not(tmp_path: Path) -> None:
    """On an object as red as the outline only the dimmed ground shows what the mask holds."""
    view = scene(tmp_path, {}).views[0]
    photo, mask = np.full((30, 40, 3), 90, np.uint8), np.zeros((30, 40), np.uint8)
    photo[..., 2] = 200  # OpenCV writes blue, green, red
    mask[10:20, 10:30] = 255
    cv2.imwrite(str(view.photo), photo)
    cv2.imwrite(str(view.mask), mask)
    drawn = (mask_sheets.outlined(view) * 255).round().astype(int)
    high, wide = drawn.shape[:2]
    assert drawn[high // 2, wide // 2].tolist() == [200, 90, 90]
    assert drawn[2, 2].tolist() == [100, 45, 45]
    assert drawn[:, wide // 2, 0].max() > 200, "the outline, drawn smoothly, is redder than both"
