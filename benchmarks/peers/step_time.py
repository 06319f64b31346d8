"""Seconds a training step takes here and in OpenSplat, on the same splats, in turns in one run.

    python benchmarks/peers/step_time.py SCENE OPENSPLAT [--resolution 200] [--rounds 3]

SCENE is a folder with a ``scene.json``, as a benchmark's store has it; OPENSPLAT the program
(``build_opensplat.sh``). Both start from the same points and neither adds nor removes any: they do
that after 500 steps at the earliest. OpenSplat's steps are timed by the lines that it prints, one
a step, so that reading photos does not count; ours by the clocks of the training loop.
"""

import argparse
import os
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import psutil

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.method import METHODS
from mattgs_ops.splat.training.train import train
from mattgs_ops.trainers.dataset import write_dataset

WARM_UP = 3  # steps of OpenSplat that are not timed
OPENSPLAT_STEPS, OUR_STEPS = 23, 200
CONDITION = Condition(background="original", method="3dgs")
CONFIG = TrainConfig(scale_schedule=False, exposure="off", checkpoint_every=0)
Seconds = tuple[float, float]  # wall, CPU


def theirs(program: Path, data: Path, out: Path, threads: int) -> Seconds:
    """Return what a step of OpenSplat takes."""
    command = [str(program), str(data), "--cpu", "--keep-crs", "--num-downscales", "0"]
    command += ["-n", str(OPENSPLAT_STEPS), "-o", str(out / "splats.ply")]
    environment = os.environ | {"OMP_NUM_THREADS": str(threads)}
    clocks = {}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("Step "):
                used = psutil.Process(process.pid).cpu_times()
                clocks[int(line.split()[1].rstrip(":"))] = time.monotonic(), used.user + used.system
    first, last = clocks[WARM_UP], clocks[OPENSPLAT_STEPS]
    steps = OPENSPLAT_STEPS - WARM_UP
    return (last[0] - first[0]) / steps, (last[1] - first[1]) / steps


def ours(scene: Scene, resolution: int, out: Path, threads: int) -> tuple[Seconds, int]:
    """Return what a step here takes, and the number of splats."""
    done = train(
        scene,
        CONDITION,
        METHODS["3dgs"],
        CONFIG,
        iterations=OUR_STEPS,
        resolution=resolution,
        seed=0,
        out=out,
        threads=threads,
    )
    assert done.splats == done.starting_splats, "no splat is added"
    return (done.wall_seconds / OUR_STEPS, done.cpu_seconds / OUR_STEPS), done.splats


def main() -> None:
    """Print one row a round, and the medians."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("opensplat", type=Path)
    parser.add_argument("--resolution", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    scene = Scene.load(options.scene)
    print(
        "| splats | OpenSplat, s a step (CPU) | ours, ms a step (CPU) | times, wall | times, CPU |"
    )
    print("|---|---|---|---|---|")
    ratios = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_dataset(
            scene,
            CONDITION.background,
            folder / "data",
            layout="colmap",
            resolution=options.resolution,
            most_points=CONFIG.max_splats,
            seed=0,
        )
        for number in range(options.rounds):
            slow = theirs(options.opensplat, folder / "data", folder, options.threads)
            out = folder / f"ours-{number}"
            fast, splats = ours(scene, options.resolution, out, options.threads)
            ratios.append((slow[0] / fast[0], slow[1] / fast[1]))
            print(
                f"| {splats:,} | {slow[0]:.3f} ({slow[1]:.3f}) | {1e3 * fast[0]:.1f} "
                f"({1e3 * fast[1]:.1f}) | {ratios[-1][0]:.0f} | {ratios[-1][1]:.0f} |",
                flush=True,
            )
    wall, cpu = (statistics.median(column) for column in zip(*ratios, strict=True))
    print(f"| median | | | {wall:.0f} | {cpu:.0f} |")


if __name__ == "__main__":
    main()
