"""Stages share the cores that are ours: never more threads than cores, nobody waits for ever."""

import io
import os
import threading
import time
from typing import Any

import pytest

from tasks.stages import cores


@pytest.fixture
def four_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {0, 1, 2, 3})
    monkeypatch.setattr(cores, "own_cores", lambda: 4)
    monkeypatch.setattr(cores, "RETRY_SECONDS", 0.01)


def test_cores_that_this_process_may_not_use_are_not_ours() -> None:
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        assert cores.own_cores() == 1
    finally:
        os.sched_setaffinity(0, before)


@pytest.mark.parametrize("quota", ["100000", "40000"])
def test_a_container_has_the_cores_that_its_share_of_time_is_worth(
    quota: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(file: Any, *_: Any) -> io.StringIO:
        if str(file) == "/proc/self/cgroup":
            return io.StringIO("0::/\n")
        if str(file).endswith("cpu.max"):
            return io.StringIO(f"{quota} 100000\n")
        raise FileNotFoundError(file)

    monkeypatch.setattr("dask.system.open", read, raising=False)
    assert cores.own_cores() == 1
    with cores.taken(1, 99) as threads:
        assert threads == 1


@pytest.mark.usefixtures("four_cores")
def test_what_can_be_spread_takes_what_is_free() -> None:
    with cores.taken(1, 1) as first, cores.taken(1, 2) as second, cores.taken(1, 4) as third:
        assert (first, second, third) == (1, 2, 1)
    with cores.taken(1, 4) as all_of_them:
        assert all_of_them == 4


@pytest.mark.usefixtures("four_cores")
def test_who_needs_more_than_there_are_holds_all_and_keeps_its_threads() -> None:
    with cores.taken(6, 6) as threads:
        assert threads == 6


@pytest.mark.usefixtures("four_cores")
def test_a_stage_waits_until_enough_cores_are_free() -> None:
    order: list[str] = []

    def late() -> None:
        with cores.taken(2, 2):
            order.append("late")

    with cores.taken(1, 3) as threads:
        thread = threading.Thread(target=late)
        thread.start()
        time.sleep(0.1)
        with cores.taken(1, 1):  # the one that is left, which is too few for the other
            order.append(f"early {threads}")
    thread.join(30)
    assert order == ["early 3", "late"]


@pytest.mark.usefixtures("four_cores")
def test_who_waits_is_told_whose_the_cores_are() -> None:
    told: list[list[str]] = []

    def late() -> None:
        with cores.taken(2, 2, "mine", told.append):
            pass

    with cores.taken(2, 2, "a longer name"), cores.taken(1, 1, "b"):
        thread = threading.Thread(target=late)
        thread.start()
        while not told:
            time.sleep(0.01)
    thread.join(30)
    assert told[0] == ["a longer name", "b"]
    told.clear()
    with cores.taken(4, 4, "c"):
        thread = threading.Thread(target=late)
        thread.start()
        while not told:
            time.sleep(0.01)
    thread.join(30)
    assert told[0] == ["c"], "what was written before is gone"


@pytest.mark.usefixtures("four_cores")
def test_threads_never_outnumber_cores() -> None:
    running, most = [0], [0]
    guard = threading.Lock()

    def work(least: int, wanted: int) -> None:
        with cores.taken(least, wanted) as threads:
            with guard:
                running[0] += threads
                most[0] = max(most[0], running[0])
            time.sleep(0.02)
            with guard:
                running[0] -= threads

    started = [threading.Thread(target=work, args=(1 + k % 3, 1 + k % 4)) for k in range(6)]
    for thread in started:
        thread.start()
    for thread in started:
        thread.join(60)
    assert not any(thread.is_alive() for thread in started)
    assert most[0] <= 4
    assert running[0] == 0


@pytest.mark.usefixtures("four_cores")
def test_holders_of_cores_are_named_and_nothing_is_taken() -> None:
    assert cores.holders() == []
    with cores.taken(2, 2, "one"), cores.taken(1, 1, "other"):
        assert cores.holders() == ["one", "other"]
        with cores.taken(1, 4) as left:
            assert left == 1
