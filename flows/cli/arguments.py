"""Options that several commands share, and what they say and exit with when they fail."""

from pathlib import Path
from typing import Annotated

import typer

from mattgs_ops.errors import InputError

DEFAULT_OUT = Path("mattgs-out")
EXIT_FAILED = 1  # a service or the disk failed
Out = Annotated[Path, typer.Option("--out", help="Folder for everything that is produced.")]
Photos = Annotated[
    Path | None, typer.Argument(help="A folder of photos of one object, from all sides.")
]
NamedPhotos = Annotated[Path | None, typer.Option("--photos", help="The same folder, by name.")]


def of_mlflow(error: Exception) -> str | None:
    """Return in a line what MLflow says, None for an error that is not MLflow's.

    It goes by the error's module: MLflow is imported late, if at all.
    """
    if not type(error).__module__.startswith("mlflow."):
        return None
    said = str(error).strip() or type(error).__name__
    return f"MLflow: {said.splitlines()[0]}"


def one_folder(command: str, photos: Path | None, named: Path | None) -> Path | None:
    """Return the folder of photos, which may be given with or without ``--photos``, once."""
    if photos is not None and named is not None:
        raise InputError(f"{command}: expected one folder of photos, found {photos} and {named}")
    return photos or named
