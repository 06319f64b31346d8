"""Training cut into laps of equal steps, each beside one run of the fixed workload.

A whole training divided by a workload timed at its ends says little on a machine whose speed
changes on the way. Lap k of one training compares with lap k of another, each relative to the
machine's speed at its own moment; the spread of these ratios says how far to trust them.
"""

from mattgs_ops import stopwatch
from mattgs_ops.calibration import calibrate

LAPS = 8


class Laps:
    """Collects laps; ``rows`` has one entry of ``value`` and ``calibration``, in seconds, each."""

    def __init__(self, iterations: int) -> None:
        self._ends = {iterations * (k + 1) // LAPS for k in range(LAPS)} - {0}
        self._wall, self._queued = 0.0, stopwatch.queued()
        self.rows: list[dict[str, float]] = []

    def add(self, step: int, wall: float) -> None:
        """Count ``wall`` seconds for the step that has just ended; at a lap's end, close it."""
        self._wall += wall
        if step not in self._ends:
            return
        disturbed = stopwatch.queued() - self._queued
        value = max(self._wall - disturbed, 0.0)
        self.rows.append({"value": value, "calibration": calibrate(1)})
        self._wall, self._queued = 0.0, stopwatch.queued()
