"""The other program itself: is it there, which version is it, and how its run goes.

Its output is read line by line, copied to the stage's log, and searched for the step that it is at.
It dies with the process that runs it; the stage's time limit ends its whole process group.
"""

import os
import re
import resource
import shutil
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

from mattgs_ops.child_process import death_with_parent, how_it_ended
from mattgs_ops.errors import StageError
from mattgs_ops.store.digests import file_digest
from mattgs_ops.trainer import TrainerConfig, fill

VERSION_SECONDS = 120.0  # importing a deep learning library alone may take half a minute
LAST_LINES = 3  # quoted when it fails
LAST_WORDS_SECONDS = 5.0  # for what it printed before it ended to be read
VERSION_LETTERS, NOTE_LETTERS = 120, 60
# As in `Step 10: 0.12 (1%)` or `iteration=10`
STEP = re.compile(r"\b(?:step|iteration|iter|it)\b\W{0,3}(\d[\d,_]*)", re.IGNORECASE)
DONE_OF_ALL = re.compile(r"(\d+)\s*/\s*(\d+)")  # a progress bar's "10/1000"
CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|[\x00-\x1f\x7f]")


@dataclass(frozen=True)
class Usage:
    """What a run took: seconds of the process and those it waited for; MiB of the largest one."""

    wall_seconds: float
    cpu_seconds: float
    peak_memory_mib: float


@dataclass(frozen=True)
class Identity:
    """Which program it is: ``version`` as it says it, ``files`` its own by name and digest."""

    version: str
    files: Mapping[str, str]


def identify(name: str, trainer: TrainerConfig) -> Identity:
    """Find the program and ask for its version.

    Of the command's arguments those that are files count, scripts for one: another content is
    another trainer. Raises :class:`StageError` when the program is not there, or its version is
    not told.
    """
    environment = environment_of(trainer)
    command = [fill(part, trainer.fixed) for part in trainer.command]
    files = [_executable(name, command[0], environment)]
    files += [Path(part) for part in command[1:] if "{" not in part and Path(part).is_file()]
    for path in files:
        if not path.is_absolute():  # it runs in a folder of its own
            raise StageError(
                f"trainer {name}: {path} is found from this folder alone; write its whole path, or "
                f"{{here}}/{path} where it lies beside the benchmark's file (docs/trainers.md)"
            )
    digests: dict[str, str] = {}
    for place, path in enumerate(files):  # two may have one name
        key = path.name if path.name not in digests else f"{path.name} ({place})"
        digests[key] = file_digest(path)
    if trainer.version is None:
        return Identity("", digests)
    command = [fill(part, trainer.fixed) for part in trainer.version]
    _executable(name, command[0], environment)
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=VERSION_SECONDS,
            check=False,
            env=environment,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise StageError(f"trainer {name}: it does not say its version: {error}") from error
    lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    if done.returncode or not lines:
        said = lines[-1] if lines else "nothing"
        raise StageError(
            f"trainer {name}: its version command ended with status {done.returncode} and said: "
            f"{said}"
        )
    return Identity(CONTROL.sub("", lines[0])[:VERSION_LETTERS], digests)


def environment_of(
    trainer: TrainerConfig, values: Mapping[str, object] | None = None
) -> dict[str, str]:
    """Return this process's environment with the trainer's own variables.

    ``values`` are those of the placeholders; None: of those that mean something before a training.
    """
    known = trainer.fixed if values is None else values
    own = {name: fill(value, known) for name, value in trainer.environment.items()}
    return {**os.environ, **own}


def _executable(name: str, program: str, environment: Mapping[str, str]) -> Path:
    path = shutil.which(program, path=environment.get("PATH"))
    if path is None:
        raise StageError(
            f"trainer {name}: there is no program {program!r} to run; install it, or give its "
            "path in `command` (docs/trainers.md)"
        )
    return Path(path)


def run(
    name: str,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    on_line: Callable[[str], None],
) -> Usage:
    """Run a program in ``folder`` to its end; every line of its output goes to ``on_line``.

    It has ended when its own process has, whatever it started that still holds its output open.
    Raises :class:`StageError` when it cannot start, or ends with anything but success, and what
    ``on_line`` raises, which ends the program.
    """
    last: deque[str] = deque(maxlen=LAST_LINES)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.monotonic()
    try:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,  # and a carriage return ends a line too, as progress bars need
            errors="replace",
            preexec_fn=death_with_parent(),  # noqa: PLW1509 - it takes no lock
        )
    except OSError as error:
        raise StageError(f"trainer {name}: {command[0]} does not start: {error}") from error
    broken: list[BaseException] = []

    def listen() -> None:
        assert process.stdout is not None
        try:
            with process.stdout:
                for raw in process.stdout:
                    line = CONTROL.sub("", raw).strip()
                    if line:
                        last.append(line)
                        on_line(line)
        except BaseException as error:
            broken.append(error)
            process.kill()

    reader = Thread(target=listen, daemon=True)
    try:
        reader.start()
        code = process.wait()
    except BaseException:
        process.kill()
        raise
    seconds = time.monotonic() - began
    reader.join(LAST_WORDS_SECONDS)
    if broken:
        raise broken[0]
    if code != 0:
        said = " | ".join(last) or "it printed nothing"
        raise StageError(f"trainer {name}: its process {how_it_ended(code)}: {said}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Usage(seconds, cpu, after.ru_maxrss / 1024.0)


def step_of(line: str, total: int, pattern: str | None) -> int | None:
    """Return the step that a line tells, None where it tells none; ``total`` is the last."""
    if pattern is not None:
        found = re.search(pattern, line)
        number = None if found is None else found[1]
    else:
        # a bar of something else, such as the loading of photos, has another length
        bars = (bar[1] for bar in DONE_OF_ALL.finditer(line) if int(bar[2]) == total)
        found = STEP.search(line)
        number = next(bars, None if found is None else found[1])
    digits = re.sub(r"\D", "", number or "")
    return min(int(digits), total) if digits else None
