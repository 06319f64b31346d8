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
    rounds. At least ``fewest_seconds`` of rendering are timed.
    Meant to run alone on its machine; time lost to others is not counted
    (:mod:`mattgs_ops.timing.stopwatch`).
    """
    shown: Colour = WHITE if condition.background == "nobg" else background
    cameras = [camera_at(view, resolution) for view in scene.registered("test")]
    if not cameras:
        raise StageError(f"scene {scene.name}: expected test views with a camera, found none")
    splats = read_ply(splats_ply)
    pairs, rendered = calibration.Pairs(), 0.0
    for index, took in time_views(splats, cameras, shown, threads=threads):
        pairs.add(took)
        rendered += took
        round_ended = index == len(cameras) - 1
        enough = len(pairs) >= FEWEST_ROUNDS * len(cameras) and rendered >= fewest_seconds
        if round_ended and enough:
            break
    views, workloads = pairs.seconds()
    rounds = views.reshape(-1, len(cameras))
    mean = np.mean([calibration.undisturbed(seconds) for seconds in rounds.T])
    ratios = rounds / workloads.reshape(rounds.shape)
    deviation = float(np.median(np.abs(np.log(ratios / np.median(ratios, axis=0)))))
    return {
        "fps": len(pairs) / rendered,
        "calibration": float(workloads.min()),
        "fps_calibrated": float(calibration.undisturbed(workloads) / mean),
        "fps_noise": QUARTILE_ERROR * deviation / float(np.sqrt(len(pairs))),
    }
