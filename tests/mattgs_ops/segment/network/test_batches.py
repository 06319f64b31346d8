"""Traced views whose object is cut out and put before another place."""

import json
from pathlib import Path

import cv2
import numpy as np

from mattgs_ops.segment.network.batches import Batches
from mattgs_ops.segment.network.train_config import (
    AugmentConfig,
    RenderedConfig,
    SegmentTrainConfig,
    StageConfig,
)

SIDE = 48
OBJECT, HERE, THERE = (40, 200, 90), (20, 20, 220), (220, 30, 30)  # BGR, as OpenCV writes


def traced(folder: Path) -> Path:
    """Write one view of a square on one ground, and another place without an object."""
    for name in ("images", "masks", "empty"):
        (folder / name).mkdir(parents=True)
    image = np.full((SIDE, SIDE, 3), HERE, np.uint8)
    mask = np.zeros((SIDE, SIDE), np.uint8)
    image[12:36, 12:36], mask[12:36, 12:36] = OBJECT, 255
    cv2.imwrite(str(folder / "images" / "00_01_00.png"), image)
    cv2.imwrite(str(folder / "masks" / "00_01_00.png"), mask)
    cv2.imwrite(str(folder / "empty" / "00_00_00.png"), np.full((30, 40, 3), THERE, np.uint8))
    listing = {"00_00_00.png": {"top": 0.0, "pose": np.eye(4).tolist()}}
    (folder / "place00.json").write_text(json.dumps(listing), encoding="utf-8")
    return folder


def grounds(folder: Path, pasted: float) -> list[str]:
    """Say for each image of a batch which of the two places its corner shows."""
    config = SegmentTrainConfig(
        stages=(StageConfig(size=SIDE, batch=40, steps=1),),
        rendered=RenderedConfig(share=1.0, pasted=pasted),
        augment=AugmentConfig(crop=1.0, rotation=0.0),
        rescale=SIDE,
    )
    images, masks = Batches(config, folder).at(0)
    found = []
    for image, mask in zip(images, masks, strict=True):
        inside, corner = image[mask > 250].mean(0), image[2:8, 2:8].mean((0, 1))
        assert (mask > 127).mean() == (24 / SIDE) ** 2
        if np.ptp(inside) > 30:  # not turned grey
            assert inside[1] > inside[0], "the object is what it was"
            found.append("there" if corner[2] > corner[0] else "here")
    return found


def test_so_many_objects_stand_before_another_place_as_asked(tmp_path: Path) -> None:
    folder = traced(tmp_path)
    assert set(grounds(folder, 0.0)) == {"here"}
    assert set(grounds(folder, 1.0)) == {"there"}
    half = grounds(folder, 0.5)
    assert 0.2 < half.count("there") / len(half) < 0.8
