"""Specification of the worker process: whatever ends it, the caller lives on and knows why."""

import json
from collections.abc import Callable
from pathlib import Path
from signal import Signals

import psutil
import pytest

from mattgs_ops import sfm
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.sfm.colmap import process
from mattgs_ops.sfm.colmap.job import Answer, Job, JobView

CONFIG = SfmConfig()


def is_worker(process: psutil.Process) -> bool:
    try:
        return "mattgs_ops.sfm.colmap.worker" in process.cmdline()
    except (psutil.NoSuchProcess, psutil.ZombieProcess):  # it has just ended
        return False


def children() -> list[psutil.Process]:
    return [child for child in psutil.Process().children() if is_worker(child)]


@pytest.mark.parametrize("signal", [Signals.SIGABRT, Signals.SIGSEGV, Signals.SIGKILL])
def test_a_crash_becomes_an_error_with_the_logs_last_lines(
    box_capture: PreparedCapture, tmp_path: Path, signal: Signals
) -> None:
    def crash(done: int, total: int, note: str) -> None:  # noqa: ARG001 -- a progress listener
        for child in children():
            child.send_signal(signal)

    out = tmp_path / "out"
    with pytest.raises(
        StageError, match=f"its process was ended by {signal.name}.*; the last lines of"
    ):
        sfm.reconstruct(box_capture, box_capture.folder / "masks", CONFIG, out, progress=crash)
    assert [path.name for path in out.iterdir()] == ["sfm.log"]


def test_a_listener_that_raises_stops_the_worker(
    box_capture: PreparedCapture, tmp_path: Path
) -> None:
    class CancelledError(Exception):
        pass

    def cancel(done: int, total: int, note: str) -> None:  # noqa: ARG001 -- a progress listener
        raise CancelledError

    with pytest.raises(CancelledError):
        sfm.reconstruct(
            box_capture, box_capture.folder / "masks", CONFIG, tmp_path / "out", progress=cancel
        )
    assert children() == []


def run_code(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Answer:
    """Run another program in the worker's place."""
    script = tmp_path / "worker.py"
    script.write_text(code)
    monkeypatch.setattr(process, "WORKER", (str(script),))
    job = Job(str(tmp_path), (), SfmConfig().model_dump(mode="json"), 1)
    said: list[str] = []
    return process.run_worker(job, tmp_path / "log", lambda d, t, n: said.append(f"{d}/{t} {n}"))


def test_words_of_libraries_on_standard_output_go_to_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "import sys\nprint('a library says hello')\nprint('7')\n"
        "print('and more', file=sys.stderr)\nsys.exit(9)\n"
    )
    with pytest.raises(StageError, match="its process ended with status 9") as error:
        run_code(code, tmp_path, monkeypatch)
    for words in ("a library says hello", "and more"):
        assert words in str(error.value)


def test_a_worker_that_says_nothing_is_still_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(StageError, match=r"ended with status 1(.|\n)*the log is empty"):
        run_code("import os\nos._exit(1)\n", tmp_path, monkeypatch)


def test_a_full_disk_is_told_before_the_log_whose_colours_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = "import sys\nprint('\\x1b[0;33mW2026 a warning', file=sys.stderr)\nsys.exit(1)\n"
    monkeypatch.setattr(process, "full_among", list)
    with pytest.raises(StageError) as error:
        run_code(code, tmp_path, monkeypatch)
    assert str(error.value) == (
        f"structure-from-motion: {tmp_path}: no room is left; its process ended with status 1; "
        f"the last lines of {tmp_path / 'log'}:\nW2026 a warning"
    )


def test_a_success_without_an_answer_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(StageError, match="ended without an answer"):
        run_code("", tmp_path, monkeypatch)


def test_jobs_and_answers_survive_their_files(tmp_path: Path) -> None:
    views = (
        JobView("a.jpg", "/p/a.jpg.png", "/m/a.jpg.png", 4, 3, (1.0, 2.0, 3.0, 4.0), None),
        JobView("b.jpg", "/p/b.jpg.png", "/m/b.jpg.png", 4, 3, None, tuple(map(float, range(12)))),
    )
    job = Job(str(tmp_path), views, SfmConfig(mode="masked").model_dump(mode="json"), 2)
    assert Job.load(job.save()) == job
    assert job.sfm.mode == "masked"
    assert not job.poses_known
    answer = Answer("shared", {"a": (5, 2)}, seconds={"map": 1.5}, registered=["a"])
    answer.save(tmp_path)
    assert Answer.load(tmp_path) == answer


@pytest.mark.parametrize(("kind", "text"), [("photo", "readable photo"), ("mask", "readable mask")])
def test_an_error_of_ours_inside_the_worker_keeps_its_words(
    tmp_path: Path, kind: str, text: str, copied: Callable[..., PreparedCapture]
) -> None:
    capture = copied()
    rows = [
        JobView(v.name, str(v.photo), str(v.mask), v.width, v.height, None, None)
        for v in capture.views
    ]
    gone = capture.views[2].photo if kind == "photo" else capture.views[2].mask
    assert gone is not None
    gone.unlink()  # after the checks, so to speak
    job = Job(str(tmp_path), tuple(rows), SfmConfig().model_dump(mode="json"), 1)
    said: list[tuple[int, int]] = []
    with pytest.raises(InputError, match=rf"0002\.jpg\.png: expected a {text}"):
        process.run_worker(job, tmp_path / "log", lambda d, t, _: said.append((d, t)))
    assert said  # the first views were extracted
    assert json.loads((tmp_path / "job.json").read_text())["threads"] == 1
