"""Which fixed workload says best how fast the machine is for rendering: candidates in one run.

    python benchmarks/timing/calibration.py [--processes 8] [--seconds 4]

Each process renders one scene, view after view, and times every candidate after each view, so that
all see the same moments. Printed is what is left of a view's seconds once they are divided by the
workload's, lower quartiles both: the spread between processes, and the shift while a neighbour on
another core copies memory or computes. A good workload leaves little of either.
"""

import argparse
import json
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch

from benchmarks.engine import WHITE, scene
from mattgs_ops.splat.render import time_views
from mattgs_ops.timing import stopwatch
from mattgs_ops.timing.calibration import ADDITIONS, GATHERED, TABLE_FLOATS, undisturbed

SPLATS, WIDTH, HEIGHT = 4000, 64, 48
CACHED = 4096  # floats that stay in the first-level cache
COPIED = 1 << 24  # floats that a neighbour copies: beyond all caches
NEIGHBOURS = ("nobody", "copies memory", "computes")


def candidates() -> dict[str, Callable[[], object]]:
    """Return the workloads by name."""
    rng = np.random.default_rng(0)
    table = rng.random(TABLE_FLOATS, dtype=np.float32)
    swept = np.stack([rng.random(2 * TABLE_FLOATS, dtype=np.float32)] * 2)
    places = rng.integers(0, TABLE_FLOATS, GATHERED)
    cached = rng.random(CACHED, dtype=np.float32)

    def additions() -> int:
        total = 0
        for number in range(ADDITIONS):
            total += number * number
        return total

    def exponentials() -> None:
        for step in range(80):
            np.exp(cached * np.float32(-0.5 - step / 80))

    return {
        "none (raw seconds)": lambda: None,
        "additions in the interpreter": additions,
        "additions and gathers (ours)": lambda: (additions(), table[places].sum()),
        "exponentials in cache": exponentials,
        "a sweep through memory": lambda: np.multiply(swept[0], np.float32(0.9), out=swept[1]),
    }


def one_process(seconds: float) -> dict[str, float]:
    """Return the logarithm of a view's seconds in workloads, by candidate."""
    torch.set_num_threads(1)
    splats, camera = scene(SPLATS, WIDTH, HEIGHT)
    timed = candidates()
    views: list[float] = []
    workloads: dict[str, list[float]] = {name: [] for name in timed}
    ends = time.monotonic() + seconds
    for _, took in time_views(splats, [camera], WHITE):
        views.append(took)
        for name, work in timed.items():
            began = stopwatch.seconds()
            work()
            workloads[name].append(stopwatch.seconds() - began)
        if time.monotonic() > ends:
            break
    raw = next(iter(timed))
    fastest = {name: 1.0 if name == raw else undisturbed(workloads[name]) for name in timed}
    return {name: float(np.log(undisturbed(views) / fastest[name])) for name in timed}


@contextmanager
def neighbour(kind: str) -> Iterator[None]:
    """Keep another core busy."""
    if kind == "nobody":
        yield
        return
    other = multiprocessing.Process(target=_disturb, args=(kind,), daemon=True)
    other.start()
    try:
        yield
    finally:
        other.kill()
        other.join()


def _disturb(kind: str) -> None:
    ours, theirs = np.ones(COPIED, np.float32), np.empty(COPIED, np.float32)
    small = ours[:CACHED]
    while True:
        if kind == "computes":
            np.exp(small)
        else:
            np.copyto(theirs, ours)


def main() -> None:
    """Print a line per candidate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--processes", type=int, default=8, help="per neighbour")
    parser.add_argument("--seconds", type=float, default=4.0, help="of one process")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one_process(options.seconds)))
        return
    command = [sys.executable, "-m", "benchmarks.timing.calibration", "--one"]
    command += ["--seconds", str(options.seconds)]
    found: dict[str, list[dict[str, float]]] = {}
    for kind in NEIGHBOURS:
        with neighbour(kind):
            prints = [subprocess.check_output(command) for _ in range(options.processes)]
        found[kind] = [json.loads(text) for text in prints]
    print("| workload | spread of processes | shift beside copies | shift beside computing |")
    print("|---|--:|--:|--:|")
    for name in candidates():
        quiet, *busy = (np.array([one[name] for one in found[kind]]) for kind in NEIGHBOURS)
        shifts = [f"{(values.mean() - quiet.mean()):+.1%}" for values in busy]
        print(f"| {name} | {quiet.std(ddof=1):.1%} | {' | '.join(shifts)} |")


if __name__ == "__main__":
    main()
