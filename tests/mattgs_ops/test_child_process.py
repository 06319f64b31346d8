"""Processes that work for another one: they end with it, and how they ended is told."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mattgs_ops.child_process import how_it_ended

MIDDLE = """
import subprocess, sys
from mattgs_ops.child_process import death_with_parent
child = subprocess.Popen(["sleep", "60"], preexec_fn=death_with_parent())
print(child.pid, flush=True)
sys.stdin.read()
"""


def is_alive(process: int) -> bool:
    try:
        told = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except FileNotFoundError:
        return False
    return told.rsplit(")", 1)[1].split()[0] != "Z"  # a zombie has ended


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends children with their parent")
def test_a_child_ends_when_its_parent_is_killed() -> None:
    middle = subprocess.Popen(
        [sys.executable, "-c", MIDDLE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with middle:
        assert middle.stdout is not None
        child = int(middle.stdout.readline())
        assert is_alive(child)
        middle.kill()
    for _ in range(200):
        if not is_alive(child):
            return
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the child outlived its parent")


def test_a_process_whose_parent_is_gone_ends_at_once() -> None:
    call = "from mattgs_ops.child_process import die_with_parent; die_with_parent(1)"
    command = [sys.executable, "-c", call]
    ended = subprocess.run(command, check=False, capture_output=True, text=True)
    assert ended.returncode == 1
    assert "is gone" in ended.stderr


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (9, "ended with status 9"),
        (-signal.SIGTERM, "was ended by SIGTERM"),
        (-signal.SIGKILL, "was ended by SIGKILL (out of memory?)"),
        (-40, "was ended by signal 40"),
    ],
)
def test_an_ending_in_words(status: int, words: str) -> None:
    assert how_it_ended(status) == words
