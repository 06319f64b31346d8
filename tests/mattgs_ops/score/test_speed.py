"""Speed is measured over the held-out views, beside a fixed workload."""

from pathlib import Path

import pytest

from mattgs_ops.capture.scene import Scene
from mattgs_ops.errors import StageError
from mattgs_ops.score.speed import measure_speed
from tests.mattgs_ops.score.conftest import (
    ORIGINAL,
    WIDTH,
    changed,
)


def test_speed_is_of_the_test_views_beside_the_fixed_workload(scene: Scene, ply: Path) -> None:
    speed = measure_speed(scene, ply, ORIGINAL, WIDTH, fewest_seconds=0.02)
    assert set(speed) == {"fps", "calibration", "fps_calibrated", "fps_noise"}
    # the undisturbed views against the mean rate and the fastest workload: alike, not equal
    assert 0.2 < speed["fps_calibrated"] / (speed["fps"] * speed["calibration"]) < 5
    assert speed["fps_noise"] >= 0
    assert min(speed["fps"], speed["calibration"]) > 0
    none = changed(changed(scene, 0, camera=None), 8, camera=None)
    with pytest.raises(StageError, match="found none"):
        measure_speed(none, ply, ORIGINAL, WIDTH)
