"""Training cut into laps of equal steps, each in turns with the fixed workload.

A whole training divided by a workload timed at its ends says little on a machine whose speed
changes on the way. Lap k of one training compares with lap k of another, each relative to the
machine's speed at its own moments; the spread of these ratios says how far to trust them.
"""

import math

import numpy as np

from mattgs_ops.timing.calibration import Pairs, undisturbed

LAPS = 8
PIECE_WORKLOADS = 10  # a piece of training between two workloads lasts this many times the fastest
FIRST_SECONDS = 0.01  # of training before the first workload: what ten take on a recent core
MOST_PIECES = 32  # in a lap: longer trainings need no more of them


class Laps:
    """Collects laps; ``rows`` has one entry of ``value`` and ``calibration``, in seconds, each.

    ``value`` is the lap's seconds. ``calibration`` is the workload's seconds for which the two have
    the ratio of an undisturbed step to an undisturbed workload, times the lap's steps.
    """

    def __init__(self, iterations: int) -> None:
        self._ends = {iterations * (k + 1) // LAPS for k in range(LAPS)} - {0}
        self._fewest = max(1, iterations // (LAPS * MOST_PIECES))
        self._pairs, self._steps = Pairs(), 0
        self._pieces: list[int] = []  # steps of each of this lap's, the latest pairs
        self._seconds = self._piece = 0.0
        self._fastest = math.inf
        self.rows: list[dict[str, float]] = []

    def add(self, step: int, seconds: float) -> None:
        """Count the undisturbed ``seconds`` of the step that has just ended; close a full lap."""
        self._seconds += seconds
        self._piece += seconds
        self._steps += 1
        ended = step in self._ends
        known = self._fastest < math.inf
        least = PIECE_WORKLOADS * self._fastest if known else FIRST_SECONDS
        if ended or (self._piece >= least and self._steps >= self._fewest):
            self._fastest = min(self._fastest, self._pairs.add(self._piece))
            self._pieces.append(self._steps)
            self._piece, self._steps = 0.0, 0
        if ended:
            self._close()

    def fastest_workload(self) -> float:
        """Return the seconds of the fastest workload so far, infinite before the first one."""
        return self._fastest

    def _close(self) -> None:
        steps = np.array(self._pieces)
        pieces, workloads = self._pairs.seconds()[:, -len(steps) :]
        step = undisturbed(pieces / steps)
        per_step = self._seconds / steps.sum()
        calibration = undisturbed(workloads) * per_step / step
        self.rows.append({"value": self._seconds, "calibration": float(calibration)})
        self._pieces, self._seconds = [], 0.0
