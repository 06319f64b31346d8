"""How fast splats render, beside a fixed workload; measured when nothing else runs."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition
from mattgs_ops.errors import StageError
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.photos import WHITE, Colour, camera_at
from mattgs_ops.splat.render import time_views
from mattgs_ops.timing import calibration

# Over the views, rendering and workload in turns; how much more of them would tell is printed by
# benchmarks/timing/speed_rounds.py
FEWEST_ROUNDS = 5
FEWEST_SECONDS = 1.0  # of renderings and workloads
# Standard error of a normal sample's lower quartile, times root n, over the median absolute
# deviation
QUARTILE_ERROR = 1.4826 * 1.3626


def measure_speed(
    scene: Scene,
    splats_ply: Path,
    condition: Condition,
    resolution: int,
    *,
    background: Colour = WHITE,
    threads: int = 1,
    fewest_seconds: float = FEWEST_SECONDS,
) -> dict[str, float]:
    """Return metrics of rendering speed over the registered test views, by id.

    Rendering a view and the fixed workload take turns, in rounds over the views. ``fps``: views
    divided by the seconds of rendering them into memory, after a warm-up; ``calibration``: seconds
    of the fastest workload; ``fps_calibrated``: frames rendered in the time of one workload, both
    by what is :func:`~mattgs_ops.timing.calibration.undisturbed`, each view by itself;
    ``fps_noise``: the relative standard error of that, from the median absolute deviation of the
    rounds. At least ``fewest_seconds`` of renderings and workloads are timed.
    Meant to run alone on its machine; time lost to others is not counted
    (:mod:`mattgs_ops.timing.stopwatch`).
    """
    shown: Colour = WHITE if condition.background == "nobg" else background
    cameras = [camera_at(view, resolution) for view in scene.registered("test")]
    if not cameras:
        raise StageError(f"scene {scene.name}: expected test views with a camera, found none")
    splats = read_ply(splats_ply)
    pairs, timed = calibration.Pairs(), 0.0
    for index, took in time_views(splats, cameras, shown, threads=threads):
        timed += took + pairs.add(took)
        round_ended = index == len(cameras) - 1
        enough = len(pairs) >= FEWEST_ROUNDS * len(cameras) and timed >= fewest_seconds
        if round_ended and enough:
            break
    views, workloads = pairs.seconds()
    return from_pairs(views, workloads, len(cameras))


def from_pairs(
    views: NDArray[np.float64], workloads: NDArray[np.float64], cameras: int
) -> dict[str, float]:
    """Return the metrics of :func:`measure_speed` from seconds of views and of their workloads.

    Both [rounds * cameras]: round after round, each over all cameras.
    """
    rounds = views.reshape(-1, cameras)
    mean = np.mean([calibration.undisturbed(seconds) for seconds in rounds.T])
    ratios = rounds / workloads.reshape(rounds.shape)
    deviation = float(np.median(np.abs(np.log(ratios / np.median(ratios, axis=0)))))
    return {
        "fps": len(views) / float(views.sum()),
        "calibration": float(workloads.min()),
        "fps_calibrated": float(calibration.undisturbed(workloads) / mean),
        "fps_noise": QUARTILE_ERROR * deviation / float(np.sqrt(len(views))),
    }
