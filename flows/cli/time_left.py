"""How long a benchmark will still take, from how far its stages are.

A stage that has not begun is expected to take what finished ones of its kind took in this run. As
long as there are none, :data:`TYPICAL` says how kinds compare, and the stages that did end say how
fast this machine is.
"""

from collections.abc import Sequence
from statistics import mean

from tasks.stages.status import Status

# Seconds of each kind at the quick setting on one quiet core; only their ratios matter
TYPICAL = {
    "prepare": 2.0,
    "segment": 30.0,
    "sfm": 50.0,
    "agree": 40.0,
    "train": 25.0,
    "truth": 1.0,
    "evaluate": 2.0,
    "measure": 10.0,
}
ALONE = ("measure",)  # runs while nothing else does
FEWEST_SHARE = 0.05  # of a running stage, from which on its own pace is believed


def seconds_left(stages: Sequence[Status], lanes: int, now: float) -> float | None:
    """Return the seconds until all stages have ended, ``lanes`` at a time; None: not known yet.

    ``now`` is in seconds since the epoch, as the stages' own times are.
    """
    took: dict[str, list[float]] = {}
    for one in stages:
        expected = _by_its_pace(one, now)
        if one.state == "done":
            took.setdefault(one.stage, []).append(one.seconds)
        elif expected is not None:
            took.setdefault(one.stage, []).append(expected)
    usual = sum(TYPICAL.get(kind, 0.0) * len(found) for kind, found in took.items())
    if not usual:
        return None
    pace = sum(sum(times) for kind, times in took.items() if kind in TYPICAL) / usual
    estimates = {kind: pace * seconds for kind, seconds in TYPICAL.items()}
    estimates |= {kind: mean(times) for kind, times in took.items()}
    shared = alone = 0.0
    for one in stages:
        left = _left(one, estimates.get(one.stage, 0.0), now)
        if one.stage in ALONE:
            alone += left
        else:
            shared += left
    return shared / lanes + alone


def in_words(seconds: float | None) -> str:
    """Say it as people do: ``about 4 min left``; nothing where it is not known."""
    if seconds is None:
        return ""
    minutes = round(seconds / 60)
    return f"about {minutes} min left" if minutes else "less than a minute left"


def _left(one: Status, usual: float, now: float) -> float:
    if one.state == "waiting":
        return usual
    if one.state != "running":
        return 0.0
    expected = _by_its_pace(one, now)
    return max(0.0, (usual if expected is None else expected) - (now - one.started))


def _by_its_pace(one: Status, now: float) -> float | None:
    """Return what a running stage will have taken, None as long as nothing says.

    Its pace is that since its progress last fell back: attempts differ in how much they do.
    """
    if one.state != "running" or not one.total or one.done / one.total < FEWEST_SHARE:
        return None
    began = max(one.started, one.anew)
    return began - one.started + (now - began) * one.total / one.done
