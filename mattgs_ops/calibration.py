"""How fast this machine is right now: a fixed workload, timed.

A frame rate means little without the machine that it was measured on, and shared machines change
from minute to minute. Next to every speed the seconds of one fixed workload are recorded, measured
in the same process on one thread; ``fps * calibration`` (frames in the time of one workload) then
compares across machines far better than ``fps`` does.

The workload shares no code with the engine, so that an engine that became slower shows. It does
what compositing does: arithmetic and exponentials on single precision in cache, gathers through
memory, and a sort. No linear algebra library takes part, whose threads could differ.
"""

import numpy as np
from numpy.typing import NDArray

from mattgs_ops import stopwatch

VERSION = 1  # raised when the workload changes: values of different versions do not compare
SEED = 20_240_817
CACHE_FLOATS = 16_384  # 64 KiB: first- and second-level cache
CACHE_ROUNDS = 400
TABLE_FLOATS = 1 << 20  # 4 MiB: beyond the second level
SORTED_KEYS = 200_000
REPEATS = 5  # the fastest counts: noise on a shared machine only ever adds


def calibrate(repeats: int = REPEATS) -> float:
    """Return the seconds of the fastest of ``repeats`` workloads, each some tens of ms."""
    inputs = _inputs()
    seconds = []
    for _ in range(repeats):
        began = stopwatch.seconds()
        workload(*inputs)
        seconds.append(stopwatch.seconds() - began)
    return min(seconds)


def workload(
    cache: NDArray[np.float32], table: NDArray[np.float32], places: NDArray[np.int64]
) -> float:
    """Do the fixed work; the result depends on all of it."""
    light, colour = np.ones_like(cache), np.zeros_like(cache)
    for step in range(CACHE_ROUNDS):
        alpha = np.exp(cache * np.float32(-0.5 - step / CACHE_ROUNDS)) * np.float32(0.02)
        colour += light * alpha
        light *= np.float32(1) - alpha
    gathered = table[places]
    order = np.argsort(gathered[:SORTED_KEYS], kind="stable")
    return float(colour.mean()) + float(gathered.mean()) + float(order[0])


def _inputs() -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    rng = np.random.default_rng(SEED)
    cache = rng.random(CACHE_FLOATS, dtype=np.float32)
    table = rng.random(TABLE_FLOATS, dtype=np.float32)
    return cache, table, rng.integers(0, TABLE_FLOATS, TABLE_FLOATS)
