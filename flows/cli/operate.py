"""Commands for those who set it up and keep it running: ``mattgs init``, ``clean`` and ``serve``.

Light at the top, as ``flows/cli/app.py``, which registers them.
"""

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.arguments import DEFAULT_OUT, Out


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.command()(init)
    app.command()(clean)
    app.command()(serve)


def init(
    photos: Annotated[
        Path | None,
        typer.Option(
            help="Photos of one object, or a folder for each object; by default photos/ or images/."
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the benchmark; by default this folder's.")
    ] = None,
) -> None:
    """Write a benchmark of your captures, its gate in CI and its schedule into this folder.

    The files run as they are and explain themselves; files that are there are never overwritten.
    """
    from flows.starter.write import write

    written = write(Path(), photos, name)
    for path in written.files:
        typer.echo(f"Written: {path}")
    for note in written.notes:
        typer.echo(note)
    typer.echo("Next: mattgs run --config benchmark.toml")


def clean(
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would be removed.")
    ] = False,
    unused_for: Annotated[
        float, typer.Option(help="Spare what was used within so many hours.", min=0)
    ] = 0.0,
    out: Out = DEFAULT_OUT,
) -> None:
    """Remove stored stages that no run refers to, left work folders and idle locks.

    What a running benchmark uses stays, and the finished stages of an interrupted one. That loses
    its unfinished work, such as a training's checkpoint.
    """
    from flows.clean import clean_up

    typer.echo(clean_up(out.resolve(), unused_hours=unused_for, dry_run=dry_run))


def serve(
    schedules: Annotated[
        list[str] | None, typer.Argument(help="For example nightly/quick; by default all.")
    ] = None,
    port: Annotated[
        int,
        typer.Option(
            min=1, max=65534, help="Port of the Prefect server on this machine; reports: the next."
        ),
    ] = 4200,
    out: Out = DEFAULT_OUT,
) -> None:
    """Run what is scheduled when it is due, until Ctrl-C: this folder's prefect.yaml.

    Without that file: the project's nightly and weekly grids, and the gate.
    Starts a Prefect server with its web interface, unless Prefect's settings name one.
    """
    from flows.services import serve as serving

    serving.serve(out.resolve(), port, schedules or [])
