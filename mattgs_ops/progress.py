"""How long operations tell how far they are, without knowing who listens."""

from collections.abc import Callable

# (done, total, note): ``done`` of ``total`` units are finished; ``note`` is a few words such as
# "24.1 dB, 12 040 splats". Called often: listeners throttle, operations do not.
Progress = Callable[[int, int, str], None]


def no_progress(done: int, total: int, note: str) -> None:
    """Ignore the report."""
