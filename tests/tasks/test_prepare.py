"""Preparing a capture: what is stored under a key is what the key was made of."""

from pathlib import Path

import pytest
from PIL import Image

from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import StageError
from mattgs_ops.progress import no_progress
from tasks.prepare import operate
from tasks.stages.capture_files import capture_digest, ids_digest


def test_photos_that_were_edited_while_the_stage_waited_are_not_stored(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    for index in range(3):
        Image.new("RGB", (8, 6), (index * 40, 10, 20)).save(photos / f"{index}.png")
    capture = CaptureConfig(name="a", path=photos)
    arguments = {
        "capture": capture.model_dump(mode="json"),
        "test_every": 8,
        "files": [capture_digest(capture), ids_digest(capture)],
    }
    operate(arguments, tmp_path / "first", 1, no_progress)
    Image.new("RGB", (8, 6), (1, 2, 3)).save(photos / "0.png")
    with pytest.raises(StageError, match="a: its files changed while they were read; run again"):
        operate(arguments, tmp_path / "second", 1, no_progress)
