"""The bundled captures can be reconstructed from their photos alone; here eight views of each."""

import json
from pathlib import Path

import pytest

from mattgs_ops import sfm
from mattgs_ops.capture import prepare, source
from mattgs_ops.config import BUNDLED, CaptureConfig, SfmConfig

VIEWS = 8  # neighbours on one orbit; `benchmarks/sfm/modes.py` measures all


def first_views(name: str, folder: Path) -> None:
    """Write a bundled capture of the first views alone: the others need not be prepared."""
    bundled = source.BUNDLED_FOLDER / name
    document = json.loads((bundled / "transforms.json").read_text(encoding="utf-8"))
    frames = sorted(document["frames"], key=lambda frame: str(frame["file_path"]))[:VIEWS]
    # the first view is held out here: those of the capture's own split are not among them
    names = [frame["file_path"] for frame in frames]
    split = {"train_filenames": names[1:], "test_filenames": names[:1]}
    (folder / name).mkdir(parents=True)
    (folder / name / "transforms.json").write_text(
        json.dumps(document | {"frames": frames} | split)
    )
    for part in ("images", "masks", "ids"):
        (folder / name / part).symlink_to(bundled / part)


@pytest.mark.parametrize("name", BUNDLED)
def test_neighbouring_photos_register_where_the_renderer_had_them(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first_views(name, tmp_path / "bundled")
    monkeypatch.setattr(source, "BUNDLED_FOLDER", tmp_path / "bundled")
    capture = prepare.prepare(CaptureConfig(name=name), tmp_path / "capture", test_every=8)
    assert capture.cameras_are == "truth", "known to us, kept from structure-from-motion"
    assert len(capture.views) == VIEWS
    config = SfmConfig(mode="original", upsample=False)
    scene = sfm.reconstruct(capture, capture.folder / "masks", config, tmp_path / "scene")
    assert scene.extra["poses"] == "estimated"
    assert scene.extra["registered"] >= 0.95 * VIEWS, scene.extra["missing"]
    error = scene.extra["pose_error"]
    assert error["rotation_deg_max"] < 1.5
    assert error["position_max"] < 0.03  # of the orbit's radius
    assert abs(error["focal"]) < 0.03
