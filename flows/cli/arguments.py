"""Options that several commands share, and what they say and exit with when they fail."""

import io
import os
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from flows.services import background
from mattgs_ops.errors import FULL, InputError, of_the_disk

DEFAULT_OUT = Path("mattgs-out")
EXIT_FAILED = 1  # a service or the disk failed
Out = Annotated[Path, typer.Option("--out", help="Folder for everything that is produced.")]
Photos = Annotated[
    Path | None, typer.Argument(help="A folder of photos of one object, from all sides.")
]
NamedPhotos = Annotated[Path | None, typer.Option("--photos", help="The same folder, by name.")]


def end_with(told: object, code: int) -> NoReturn:
    """End the program with a line on standard error; do not wait for services that start."""
    sys.stderr.write(f"mattgs: {told}\n")
    exit_with(code)


def exit_with(code: int) -> NoReturn:
    """End the program; at once where threads are at work that would not notice."""
    if background.at_work():
        sys.stdout.flush()
        os._exit(code)
    sys.exit(code)


def of_mlflow(error: Exception) -> str | None:
    """Return in a line what MLflow says, None for an error that is not MLflow's.

    It goes by the error's module: MLflow is imported late, if at all.
    """
    if not type(error).__module__.startswith("mlflow."):
        return None
    said = str(error).strip() or type(error).__name__
    return f"MLflow: {said.splitlines()[0]}"


def of_a_disk(error: OSError) -> str | None:
    """Return in a line which place is full or what else its disk lacks, None for other errors."""
    named = [b for a, b in pairwise(sys.argv) if a == "--out"]
    named += [word.removeprefix("--out=") for word in sys.argv if word.startswith("--out=")]
    out = Path(named[-1]) if named else DEFAULT_OUT
    told = of_the_disk(error, [out, Path.cwd(), Path(tempfile.gettempdir())])
    if told is None:
        return None
    return (
        f"{told}: {'make room; ' if error.errno in FULL else ''}the same command goes on from here"
    )


def replace_what_cannot_be_printed() -> None:
    """Print `?` for characters that a terminal or a file of a log has no room for.

    Frames of tables are among them where output is not UTF-8; no finished work ends by that.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def one_folder(command: str, photos: Path | None, named: Path | None) -> Path | None:
    """Return the folder of photos, which may be given with or without ``--photos``, once."""
    if photos is not None and named is not None:
        raise InputError(f"{command}: expected one folder of photos, found {photos} and {named}")
    return photos or named
