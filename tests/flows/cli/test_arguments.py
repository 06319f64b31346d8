"""What commands say for errors of services and of the disk, and how on any terminal."""

import errno
import io
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from mlflow.exceptions import MlflowException

from flows.cli.arguments import of_a_disk, of_mlflow, replace_what_cannot_be_printed


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ("the server is gone\nat line 3", "MLflow: the server is gone"),
        ("\n the server is gone", "MLflow: the server is gone"),
        ("", "MLflow: MlflowException"),
    ],
)
def test_what_mlflow_says_is_one_line(message: str, told: str) -> None:
    assert of_mlflow(MlflowException(message)) == told


def test_errors_of_others_are_not_mlflows() -> None:
    assert of_mlflow(ValueError("no")) is None


@pytest.mark.parametrize("words", [["--out", "{}"], ["--out={}"]])
def test_the_output_folder_is_named_where_its_disk_is_full(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
    monkeypatch.setattr(sys, "argv", ["mattgs", *(word.format(tmp_path) for word in words)])
    told = of_a_disk(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    assert told is not None
    assert told.startswith(f"{tmp_path}")
    assert told.endswith(": No space left on device: make room; the same command goes on from here")


def test_a_limit_on_files_asks_for_no_room() -> None:
    told = of_a_disk(OSError(errno.EFBIG, os.strerror(errno.EFBIG)))
    assert told is not None
    assert "ulimit -f" in told
    assert "make room" not in told


def test_errors_that_are_not_a_disks_are_left_to_others() -> None:
    assert of_a_disk(OSError(errno.ENOENT, "no such file", "a.json")) is None


def test_what_a_terminal_cannot_show_becomes_a_question_mark(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    latin = io.TextIOWrapper(io.BytesIO(), encoding="latin-1")
    monkeypatch.setattr(sys, "stdout", latin)
    monkeypatch.setattr(sys, "stderr", None)  # as of a program without a terminal
    replace_what_cannot_be_printed()
    latin.write("ä ─")
    latin.flush()
    assert latin.buffer.getvalue() == "ä ?".encode("latin-1")


def test_the_command_itself_prints_frames_where_output_is_latin(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "flows.cli.app", "--help"],
        env=os.environ | {"PYTHONIOENCODING": "latin-1"},
        cwd=tmp_path,
        capture_output=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
