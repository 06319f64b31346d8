"""The bundled captures can be reconstructed from their photos alone; here ten views of each."""

from dataclasses import replace
from pathlib import Path

import pytest

from mattgs_ops import sfm
from mattgs_ops.capture import prepare
from mattgs_ops.config import BUNDLED, CaptureConfig, SfmConfig

VIEWS = 10  # neighbours on one orbit; `benchmarks/sfm.py` measures all 48


@pytest.mark.parametrize("name", BUNDLED)
def test_neighbouring_photos_register_where_the_renderer_had_them(
    name: str, tmp_path: Path
) -> None:
    whole = prepare.prepare(CaptureConfig(name=name), tmp_path / "capture", test_every=8)
    assert whole.cameras_are == "truth", "known to us, kept from structure-from-motion"
    capture = replace(whole, views=whole.views[:VIEWS])
    config = SfmConfig(mode="original", upsample=False)
    scene = sfm.reconstruct(capture, whole.folder / "masks", config, tmp_path / "scene")
    assert scene.extra["poses"] == "estimated"
    assert scene.extra["registered"] >= 0.95 * VIEWS, scene.extra["missing"]
    error = scene.extra["pose_error"]
    assert error["rotation_deg_max"] < 1.5
    assert error["position_max"] < 0.03  # of the orbit's radius
    assert abs(error["focal"]) < 0.03
