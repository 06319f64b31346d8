"""Training cut into laps of equal steps, each beside one run of the fixed workload.

A whole training divided by a workload timed at its ends says little on a machine whose speed
changes on the way. Lap k of one training compares with lap k of another, each relative to the
machine's speed at its own moment; the spread of these ratios says how far to trust them.
"""

from mattgs_ops.calibration import calibrate

LAPS = 8


class Laps:
    """Collects laps; ``rows`` has one entry of ``value`` and ``calibration``, in seconds, each."""

    def __init__(self, iterations: int) -> None:
        self._ends = {iterations * (k + 1) // LAPS for k in range(LAPS)} - {0}
        self._seconds = 0.0
        self.rows: list[dict[str, float]] = []

    def add(self, step: int, seconds: float) -> None:
        """Count the undisturbed ``seconds`` of the step that has just ended; close a full lap."""
        self._seconds += seconds
        if step in self._ends:
            self.rows.append({"value": self._seconds, "calibration": calibrate(1)})
            self._seconds = 0.0
