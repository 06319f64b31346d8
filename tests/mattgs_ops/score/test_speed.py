"""Speed is measured over the held-out views, beside a fixed workload."""

import math
from pathlib import Path
from statistics import median

import numpy as np
import pytest

from mattgs_ops.capture.scene import Scene
from mattgs_ops.errors import StageError
from mattgs_ops.score import speed
from mattgs_ops.score.speed import measure_speed
from mattgs_ops.timing import calibration
from tests.mattgs_ops.score.conftest import ORIGINAL, WIDTH, changed

VIEWS = (0.1, 0.3)  # seconds that each of the two held-out views takes
SLOWER = (1.0, 1.0, 1.1, 1.2, 1.3, 1.0, 1.1, 1.3, 1.6, 1.2, 1.0, 1.0)  # rounds, by a neighbour
WORKLOADS = (0.05, 0.05, 0.04, 0.05, 0.06)  # seconds; all others take the first one's


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


@pytest.mark.parametrize(
    ("fewest_seconds", "rounds"),
    # five rounds are the fewest; they take 2.24 seconds and their workloads 0.5, less than 0.1 of
    # which is missing; a round that was begun is ended
    [(0.1, 5), (2.7, 5), (2.8, 6)],
)
def test_speed_is_worked_out_of_rounds_over_the_views(
    scene: Scene, ply: Path, monkeypatch: pytest.MonkeyPatch, fewest_seconds: float, rounds: int
) -> None:
    took = [(view, seconds * slower) for slower in SLOWER for view, seconds in enumerate(VIEWS)]
    workloads = [*WORKLOADS, *[WORKLOADS[0]] * (len(took) - len(WORKLOADS))]
    clock = iter([9.0, *workloads])  # the first one touches its memory
    monkeypatch.setattr(speed, "time_views", lambda *_, **__: iter(took))
    monkeypatch.setattr(calibration, "_timed", lambda _: next(clock))
    found = measure_speed(scene, ply, ORIGINAL, WIDTH, fewest_seconds=fewest_seconds)
    timed = [seconds for _, seconds in took[: 2 * rounds]]
    assert found["fps"] == pytest.approx(len(timed) / sum(timed))
    assert found["calibration"] == min(WORKLOADS)
    undisturbed = float(np.mean(VIEWS)) * float(np.quantile(SLOWER[:rounds], 0.25))
    assert found["fps_calibrated"] == pytest.approx(WORKLOADS[0] / undisturbed)
    ratios = [seconds / workload for seconds, workload in zip(timed, workloads, strict=False)]
    usual = [median(ratios[view::2]) for view in (0, 1)]
    away = median(abs(math.log(ratio / usual[place % 2])) for place, ratio in enumerate(ratios))
    # of a normal sample: deviation over median absolute deviation, lower quartile's error
    assert found["fps_noise"] == pytest.approx(1.4826 * 1.3626 * away / math.sqrt(len(timed)))
