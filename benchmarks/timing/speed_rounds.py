"""How many rounds over the views a measurement of rendering speed needs.

    python benchmarks/timing/speed_rounds.py [--processes 12]

Each process renders the same scene from the same cameras, nine rounds with a workload after each
view, as ``mattgs_ops/score/speed.py`` does. The first 3, the first 5 and all 9 rounds are made into
a speed each, so that all see the same machine. Printed is the spread of that speed over processes,
what it says of its own error, and how far it lies from that of nine.
"""

import argparse
import json
import subprocess
import sys

import numpy as np
import torch

from benchmarks.engine import WHITE, scene
from mattgs_ops.score.speed import from_pairs
from mattgs_ops.splat.render import time_views
from mattgs_ops.timing.calibration import Pairs

SPLATS, WIDTH, HEIGHT = 12_000, 64, 48  # as in quick-ci.toml
CAMERAS = 24
ROUNDS = (3, 5, 9)


def one_process() -> dict[int, dict[str, float]]:
    """Return the metrics of speed by number of rounds."""
    torch.set_num_threads(1)
    splats, camera = scene(SPLATS, WIDTH, HEIGHT)
    pairs = Pairs()
    for _, took in time_views(splats, [camera] * CAMERAS, WHITE):
        pairs.add(took)
        if len(pairs) == max(ROUNDS) * CAMERAS:
            break
    views, workloads = pairs.seconds()
    return {n: from_pairs(views[: n * CAMERAS], workloads[: n * CAMERAS], CAMERAS) for n in ROUNDS}


def main() -> None:
    """Print a line per number of rounds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--processes", type=int, default=12)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one_process()))
        return
    command = [sys.executable, "-m", "benchmarks.timing.speed_rounds", "--one"]
    found = [json.loads(subprocess.check_output(command)) for _ in range(options.processes)]
    print("| rounds | spread of processes | its own error | against nine |")
    print("|--:|--:|--:|--:|")
    nine = np.log([one[str(max(ROUNDS))]["fps_calibrated"] for one in found])
    for rounds in ROUNDS:
        speeds = np.log([one[str(rounds)]["fps_calibrated"] for one in found])
        own = np.mean([one[str(rounds)]["fps_noise"] for one in found])
        away = (speeds - nine).mean()
        print(f"| {rounds} | {speeds.std(ddof=1):.2%} | {own:.2%} | {away:+.2%} |")


if __name__ == "__main__":
    main()
