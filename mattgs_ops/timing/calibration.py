"""How fast this machine is right now: a fixed workload, timed.

A frame rate means little without the machine that it was measured on, and shared machines change
from second to second. Next to every speed the seconds of one fixed workload are recorded, measured
in the same process on one thread; ``fps * calibration`` (frames in the time of one workload) then
compares across machines far better than ``fps`` does.

A workload takes about a millisecond, so that it can stand right beside each piece of what is
measured: what slows the machine for a moment slows both. Of many pieces, and of the workloads
beside them, the lower quartile counts (:func:`undisturbed`): others only ever add time, and the
single fastest is luck.

The workload shares no code with the engine, so that an engine that became slower shows. Most of it
is arithmetic in the interpreter, which follows the core's own pace and stays in the first-level
cache. The rest gathers through memory, as much as makes it lose what the engine loses when a
neighbour takes bandwidth. ``benchmarks/timing/calibration.py`` compares it with other workloads.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mattgs_ops.timing import stopwatch

VERSION = 3  # raised when the workload changes: values of different versions do not compare
SEED = 20_240_817
ADDITIONS = 16_000  # of squares, in the interpreter
TABLE_FLOATS = 1 << 20  # 4 MiB: beyond the second level
GATHERED = 1 << 13
REPEATS = 100  # the fastest counts: noise on a shared machine only ever adds
UNDISTURBED = 0.25  # share of the measurements that are taken for undisturbed

Workload = tuple[NDArray[np.float32], NDArray[np.int64]]


def calibrate(repeats: int = REPEATS) -> float:
    """Return the seconds of the fastest of ``repeats`` workloads, each about a millisecond."""
    inputs = _inputs()
    return min(_timed(inputs) for _ in range(repeats))


def undisturbed(seconds: ArrayLike) -> float:
    """Return the seconds below which a quarter of the measurements lie."""
    return float(np.quantile(np.asarray(seconds, dtype=np.float64), UNDISTURBED))


class Pairs:
    """Pieces of work, each with one workload right after it."""

    def __init__(self) -> None:
        self._inputs = _inputs()
        self._pairs: list[tuple[float, float]] = []
        _timed(self._inputs)  # the first touch of its memory does not count

    def __len__(self) -> int:
        return len(self._pairs)

    def add(self, seconds: float) -> float:
        """Put one workload beside a piece that has just taken ``seconds``; return its seconds."""
        workload_seconds = _timed(self._inputs)
        self._pairs.append((seconds, workload_seconds))
        return workload_seconds

    def seconds(self) -> NDArray[np.float64]:
        """Return the seconds of pieces and of workloads [2, P]."""
        return np.array(self._pairs, dtype=np.float64).reshape(-1, 2).T


def workload(table: NDArray[np.float32], places: NDArray[np.int64]) -> float:
    """Do the fixed work; the result depends on all of it."""
    total = 0
    for number in range(ADDITIONS):
        total += number * number
    return total + float(table[places].sum())


def _inputs() -> Workload:
    rng = np.random.default_rng(SEED)
    table = rng.random(TABLE_FLOATS, dtype=np.float32)
    return table, rng.integers(0, TABLE_FLOATS, GATHERED)


def _timed(inputs: Workload) -> float:
    began = stopwatch.seconds()
    workload(*inputs)
    return stopwatch.seconds() - began
