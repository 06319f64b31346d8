"""How long operations tell how far they are, without knowing who listens."""

import time
from collections.abc import Callable

# (done, total, note): ``done`` of ``total`` units are finished; ``note`` is a few words such as
# "24.1 dB, 12 040 splats". Called often: listeners throttle, operations do not.
Progress = Callable[[int, int, str], None]


def no_progress(done: int, total: int, note: str) -> None:
    """Ignore the report."""


class Throttle:
    """Lets at most one report through in ``seconds``, and always the last."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._passed: float | None = None  # when a report passed last, monotonic seconds

    def passes(self, done: int, total: int) -> bool:
        """Tell whether to pass on a report of ``done`` of ``total`` units."""
        now = time.monotonic()
        if self._passed is not None and now - self._passed < self._seconds and done < total:
            return False
        self._passed = now
        return True
