"""How fast splats render, beside a fixed workload; measured when nothing else runs."""

from pathlib import Path

import numpy as np

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition
from mattgs_ops.errors import StageError
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.photos import WHITE, Colour, camera_at
from mattgs_ops.splat.render import time_views
from mattgs_ops.timing import calibration

FEWEST_ROUNDS = 9  # over the views, rendering and workload in turns
FEWEST_SECONDS = 1.0  # of rendering
# Standard error of a normal sample's median, times root n, over the median absolute deviation
MEDIAN_ERROR = 1.4826 * 1.2533


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
    of the fastest workload; ``fps_calibrated``: frames rendered in the time of one workload, each
    view at its median over the rounds; ``fps_noise``: the relative standard error of that, from the
    median absolute deviation of the rounds. At least ``fewest_seconds`` of rendering are timed.
    Meant to run alone on its machine; time lost to others is not counted
    (:mod:`mattgs_ops.timing.stopwatch`).
    """
    shown: Colour = WHITE if condition.background == "nobg" else background
    cameras = [camera_at(view, resolution) for view in scene.registered("test")]
    if not cameras:
        raise StageError(f"scene {scene.name}: expected test views with a camera, found none")
    splats = read_ply(splats_ply)
    pairs, seconds = calibration.Pairs(sweeping=False), 0.0
    for index, took in time_views(splats, cameras, shown, threads=threads):
        pairs.add(took)
        seconds += took
        round_ended = index == len(cameras) - 1
        enough = len(pairs) >= FEWEST_ROUNDS * len(cameras) and seconds >= fewest_seconds
        if round_ended and enough:
            break
    ratios = pairs.ratios().reshape(-1, len(cameras))
    by_view = np.median(ratios, axis=0)
    deviation = float(np.median(np.abs(np.log(ratios / by_view))))
    return {
        "fps": len(pairs) / seconds,
        "calibration": pairs.fastest(),
        "fps_calibrated": float(1 / by_view.mean()),
        "fps_noise": MEDIAN_ERROR * deviation / float(np.sqrt(len(pairs))),
    }
