"""Commands on results: ``mattgs promote``, ``mattgs export`` and ``mattgs view``.

Light at the top, as ``flows/cli.py``, which registers them.
"""

from pathlib import Path
from typing import Annotated

import typer

DEFAULT_OUT = Path("mattgs-out")

Out = Annotated[Path, typer.Option("--out", help="Folder for everything that is produced.")]
Run = Annotated[
    str, typer.Argument(help="A run: its id, the beginning of its id, or its name in `mattgs ui`.")
]


def register(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command()(promote)


def promote(
    run: Run,
    alias: Annotated[str, typer.Option(help="Alias in the registry.")] = "baseline",
    out: Out = DEFAULT_OUT,
) -> None:
    """Make a run the baseline of its cell, and its splats a registered MLflow model.

    Reports and the gate compare with what is promoted.
    """
    from flows.promote import promote as promote_run

    typer.echo(promote_run(run, out.resolve(), alias))
