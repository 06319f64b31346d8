"""What is known of an experiment beside its row: its photos, its command, its dates."""

from dataclasses import dataclass


@dataclass(frozen=True)
class About:
    """``photos`` is a URI and ``command`` what a person ran; empty where they are not known.

    ``began`` and ``ended`` are those of the training, in seconds since the epoch; None where there
    was none.
    """

    photos: str = ""
    command: str = ""
    began: float | None = None
    ended: float | None = None


def milliseconds(seconds: float | None) -> int | None:
    """Return a time as MLflow takes it."""
    return None if seconds is None else round(seconds * 1000)
