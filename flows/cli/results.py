"""Commands on results: ``mattgs promote``, ``mattgs export`` and ``mattgs view``.

Light at the top, as ``flows/cli/app.py``, which registers them.
"""

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.arguments import DEFAULT_OUT, Out

RUN = "A run: its id, the beginning of its id, or its name in `mattgs ui`"
Run = Annotated[str, typer.Argument(help=f"{RUN}.")]
RunOrPly = Annotated[
    str, typer.Argument(metavar="RUN_OR_PLY", help=f"{RUN}; or a PLY file with splats.")
]


def register(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command()(promote)
    app.command()(export)
    app.command()(view)


def promote(
    run: Run,
    alias: Annotated[str, typer.Option(help="Alias in the registry.")] = "baseline",
    out: Out = DEFAULT_OUT,
) -> None:
    """Make a run the baseline of its cell, and its splats a registered MLflow model.

    Reports and the gate compare with what is promoted.
    """
    from flows.results.promote import promote as promote_run

    typer.echo(promote_run(run, out.resolve(), alias))


def export(
    run: RunOrPly,
    form: Annotated[
        str, typer.Option("--format", help="ply, splat, spz or compressed-ply.")
    ] = "ply",
    file: Annotated[
        Path | None, typer.Option(help="File to write; by default below the output folder.")
    ] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Write a run's splats in the format of a viewer.

    ply is exact; spz and compressed-ply keep the view-dependent colour, rounded; splat leaves it
    out.
    """
    from flows.results.export import export as export_splats

    typer.echo(export_splats(run, form, file, out.resolve()))


def view(
    run: RunOrPly,
    port: Annotated[int, typer.Option(help="Port on this machine; 0 takes a free one.")] = 8080,
    browser: Annotated[bool, typer.Option(help="Open the browser.")] = True,
    out: Out = DEFAULT_OUT,
) -> None:
    """Look at splats in the browser, with the cameras and photos of a run, until Ctrl-C.

    Needs the extra `view`: pip install 'mattgs-bench[view]'.
    """
    from flows.results.view import view as show

    show(run, out.resolve(), port, browser=browser)
