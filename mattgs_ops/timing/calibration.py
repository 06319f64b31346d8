"""How fast this machine is right now: a fixed workload, timed.

A frame rate means little without the machine that it was measured on, and shared machines change
from second to second. Next to every speed the seconds of one fixed workload are recorded, measured
in the same process on one thread; ``fps * calibration`` (frames in the time of one workload) then
compares across machines far better than ``fps`` does.

A workload takes about a millisecond, so that it can stand right beside each piece of what is
measured: what slows the machine for a moment slows both, and the median over many such pairs
(:class:`Pairs`) forgets the moments that came between the two. ``benchmarks/gate_study.py`` prints
what that leaves.

The workload shares no code with the engine, so that an engine that became slower shows. It does
what compositing does: arithmetic and exponentials on single precision in cache, gathers through
memory, and a sort. Beside training it does, for as long again, what Adam does, a sweep through
memory: neighbours on other cores take bandwidth and leave arithmetic alone. No linear algebra
library takes part, whose threads could differ.
"""

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.timing import stopwatch

VERSION = 2  # raised when the workload changes: values of different versions do not compare
SEED = 20_240_817
CACHE_FLOATS = 16_384  # 64 KiB: first- and second-level cache
CACHE_ROUNDS = 20
TABLE_FLOATS = 1 << 20  # 4 MiB: beyond the second level
GATHERED = 1 << 13
SORTED_KEYS = 2_000
STREAM_FLOATS = 1 << 21  # 8 MiB read and 8 MiB written: about as much time as all the rest
REPEATS = 100  # the fastest counts: noise on a shared machine only ever adds

Workload = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64], NDArray[np.float32]]


def calibrate(repeats: int = REPEATS) -> float:
    """Return the seconds of the fastest of ``repeats`` workloads, each about a millisecond."""
    inputs = _inputs()
    return min(_timed(inputs) for _ in range(repeats))


class Pairs:
    """Pieces of work, each with one workload right after it, ``sweeping`` through memory or not."""

    def __init__(self, *, sweeping: bool) -> None:
        self._inputs = _inputs(sweeping=sweeping)
        self._pairs: list[tuple[float, float]] = []
        _timed(self._inputs)  # the first touch of its memory does not count

    def __len__(self) -> int:
        return len(self._pairs)

    def add(self, seconds: float) -> None:
        """Put one workload beside a piece that has just taken ``seconds``."""
        self._pairs.append((seconds, _timed(self._inputs)))

    def ratios(self) -> NDArray[np.float64]:
        """Return the pieces' seconds in workloads [P]."""
        pairs = np.array(self._pairs, dtype=np.float64).reshape(-1, 2)
        return pairs[:, 0] / pairs[:, 1]

    def fastest(self) -> float:
        """Return the seconds of the fastest workload."""
        return min(workload for _, workload in self._pairs)


def workload(
    cache: NDArray[np.float32],
    table: NDArray[np.float32],
    places: NDArray[np.int64],
    swept: NDArray[np.float32],
) -> float:
    """Do the fixed work; the result depends on all of it.

    ``swept`` [2, M]: the second row is written from the first; M = 0 for no sweep.
    """
    light, colour = np.ones_like(cache), np.zeros_like(cache)
    for step in range(CACHE_ROUNDS):
        alpha = np.exp(cache * np.float32(-0.5 - step / CACHE_ROUNDS)) * np.float32(0.02)
        colour += light * alpha
        light *= np.float32(1) - alpha
    gathered = table[places]
    order = np.argsort(gathered[:SORTED_KEYS], kind="stable")
    np.multiply(swept[0], np.float32(0.9), out=swept[1])
    last = float(swept[1, -1:].sum())
    return float(colour.mean()) + float(gathered.mean()) + float(order[0]) + last


def _inputs(*, sweeping: bool = False) -> Workload:
    rng = np.random.default_rng(SEED)
    cache = rng.random(CACHE_FLOATS, dtype=np.float32)
    table = rng.random(TABLE_FLOATS, dtype=np.float32)
    swept = np.stack([rng.random(STREAM_FLOATS if sweeping else 0, dtype=np.float32)] * 2)
    return cache, table, rng.integers(0, TABLE_FLOATS, GATHERED), swept


def _timed(inputs: Workload) -> float:
    began = stopwatch.seconds()
    workload(*inputs)
    return stopwatch.seconds() - began
