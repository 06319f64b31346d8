"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

DEFAULT_OUT = Path("mattgs-out")
Out = Annotated[Path, typer.Option("--out", help="Folder for everything that is produced.")]
