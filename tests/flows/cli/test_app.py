"""The command line: quick to answer, plain about what is wrong, no tracebacks."""

import json
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from flows.cli import app
from flows.services import background
from reports.gate import baseline

HEAVY = ("torch", "prefect", "mlflow", "dask", "distributed", "cv2", "pycolmap", "onnxruntime")


@pytest.fixture(autouse=True)
def _ctrl_c(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Give Ctrl-C and logs back to the tests: an interrupted program has none from its end on.

    A thread of another test would make it end this process.
    """
    monkeypatch.setattr(background, "at_work", lambda: False)
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)
    logging.disable(logging.NOTSET)


def mattgs(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "flows.cli.app", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def photos(folder: Path, count: int) -> Path:
    folder.mkdir()
    for index in range(count):
        Image.new("RGB", (64, 48), (10 * index, 50, 90)).save(folder / f"{index}.png")
    return folder


def test_help_names_the_commands_and_imports_nothing_heavy() -> None:
    code = (
        "import sys, flows.cli.app\n"
        "try: flows.cli.app.app(['--help'])\n"
        "except SystemExit: pass\n"
        f"print([m for m in {HEAVY!r} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    for command in ("run", "report", "status", "ui", "clean", "captures", "segment"):
        assert f" {command} " in done.stdout
    assert done.stdout.strip().endswith("[]")


def test_the_version_is_the_packages() -> None:
    done = CliRunner().invoke(app.app, ["--version"])
    assert (done.exit_code, done.output) == (0, f"mattgs {version('mattgs-bench')}\n")


def test_an_unknown_key_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text("iteration = 5\n")
    done = mattgs("run", "--config", tmp_path / "b.toml", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr == f"mattgs: {tmp_path / 'b.toml'}: unknown key `iteration`\n"
    assert not (tmp_path / "out").exists()


def test_bad_photos_end_with_a_plain_message_before_any_work_and_leave_nothing_running(
    tmp_path: Path,
) -> None:
    folder = photos(tmp_path / "cat", 4)
    (folder / "notes.txt").write_text("not a photo")
    done = mattgs("run", "--photos", folder, "--out", tmp_path / "out")
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("mattgs: ")
    assert "notes.txt" in done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert not list((tmp_path / "out").glob("store/*/*/manifest.json"))
    marker = str(tmp_path).encode()
    mine = [p for p in Path("/proc").glob("[0-9]*") if p.name != str(os.getpid())]
    assert not [p for p in mine if marker in command_line(p)]


def test_status_of_nothing_says_so(tmp_path: Path) -> None:
    done = mattgs("status", "--out", tmp_path)
    assert done.returncode == 2
    assert "no status of any benchmark" in done.stderr


def command_line(process: Path) -> bytes:
    try:
        return (process / "cmdline").read_bytes()
    except OSError:  # it has just ended
        return b""


def test_a_full_disk_is_said_plainly(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def write_to_a_full_disk() -> None:
        with Path("/dev/full").open("w") as file:
            file.write("x")

    monkeypatch.setattr(app, "app", write_to_a_full_disk)
    with pytest.raises(SystemExit, match="1"):
        app.main()
    line = "mattgs: No space left on device: make room; the same command goes on from here\n"
    assert capsys.readouterr().err == line, "no folder is said to be full: none is"


def test_ctrl_c_says_that_the_same_command_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr("flows.cli.run.run_benchmark", interrupted)
    monkeypatch.setattr(sys, "argv", ["mattgs", "run"])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == app.EXIT_INTERRUPTED
    assert capsys.readouterr().err == "mattgs: interrupted; the same command goes on from here\n"


def test_sigterm_ends_a_run_as_ctrl_c_does_and_says_which_it_was(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    closed = []

    def terminated(*_: object, **__: object) -> bool:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            closed.append("services")
        return True

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("flows.cli.run.run_benchmark", terminated)
    monkeypatch.setattr(sys, "argv", ["mattgs", "run"])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == app.EXIT_TERMINATED == 143
    told = "mattgs: ended by SIGTERM; the same command goes on from here\n"
    assert capsys.readouterr().err == told
    assert closed == ["services"]
    assert signal.getsignal(signal.SIGTERM) is before


DROPPED = """
import gc, signal, sys, time
from flows.cli import app, run

# a shell has its background jobs ignore Ctrl-C, and tests may be one
signal.signal(signal.SIGINT, signal.default_int_handler)

def callback(phase, info):
    gc.callbacks.remove(callback)
    signal.raise_signal(signal.SIGINT)

def work(*_, **__):
    gc.callbacks.append(callback)
    gc.collect()
    time.sleep(60)

run.run_benchmark = work
sys.argv = ["mattgs", "run"]
app.main()
"""
# a machine that pauses: the alarm that sends Ctrl-C again comes while it is still being set
SLOW = """
import signal, time

def setitimer(which, seconds, set_it=signal.setitimer):
    signal.setitimer = set_it
    set_it(which, seconds)
    time.sleep(4 * seconds)

signal.setitimer = setitimer
"""


@pytest.mark.parametrize("machine", ["", SLOW], ids=["", "slow"])
def test_ctrl_c_that_comes_while_memory_is_freed_is_no_less_heard(machine: str) -> None:
    program = machine + DROPPED
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == app.EXIT_INTERRUPTED
    assert done.stderr == "mattgs: interrupted; the same command goes on from here\n"


# what still ends with the process, after the end was told
ATEXIT = """
import atexit, logging, signal, sys, threading, time
from flows.cli import app, run
from flows.services.background import Background

signal.signal(signal.SIGINT, signal.default_int_handler)

def close():
    signal.raise_signal(signal.SIGINT)
    time.sleep(3 * app.AGAIN_SECONDS)
    logging.getLogger("prefect").critical("a server that does not answer any more")
    print("closed")

def work(*_, **__):
    if at_work:
        Background(threading.Event().wait)
    signal.setitimer(signal.ITIMER_REAL, app.AGAIN_SECONDS)  # as where Ctrl-C was dropped
    raise KeyboardInterrupt

atexit.register(close)
run.run_benchmark = work
at_work = bool(sys.argv[1:])
sys.argv = ["mattgs", "run"]
app.main()
"""


@pytest.mark.parametrize(("at_work", "printed"), [([], "closed\n"), (["yes"], "")])
def test_after_the_end_was_told_no_ctrl_c_is_heard_and_nothing_is_taken_down_under_threads(
    at_work: list[str], printed: str
) -> None:
    command = [sys.executable, "-c", ATEXIT, *at_work]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == app.EXIT_INTERRUPTED
    assert done.stdout == printed
    assert done.stderr == "mattgs: interrupted; the same command goes on from here\n"


def test_ctrl_c_again_while_the_first_is_being_told_ends_as_the_first_would(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(app, "app", interrupted)
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == app.EXIT_INTERRUPTED
    assert capsys.readouterr().err == "mattgs: interrupted; the same command goes on from here\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run", "--out", "afile"], "{here}/afile: expected a folder, found a file"),
        (["run", "--out", "afile/out"], "{here}/afile/out: Not a directory"),
        (["check", "--config", "b.toml", "--out", "afile/out"], "afile/out: Not a directory"),
        (["baseline", "made", "--out", "."], "made: Is a directory"),
        (["baseline", "afile/b.json", "--out", "."], "afile: expected a folder, found a file"),
    ],
)
def test_a_place_that_cannot_be_used_is_named_with_the_reason(
    arguments: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = tmp_path / "benchmarks" / "quick" / "rows.json"
    for folder in (rows.parent, tmp_path / "made"):
        folder.mkdir(parents=True)
    rows.write_text(json.dumps(list(baseline.load("quick-ci").rows)))
    (tmp_path / "afile").touch()
    (tmp_path / "b.toml").write_text("[[captures]]\nname = 'rover'\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["mattgs", *arguments])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == app.EXIT_INPUT
    assert capsys.readouterr().err == f"mattgs: {told.format(here=tmp_path)}\n"


def test_help_keeps_what_stands_in_brackets() -> None:
    told = CliRunner().invoke(app.app, ["view", "--help"]).output
    assert "pip install 'mattgs-bench[view]'." in told
