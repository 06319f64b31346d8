"""Commands on results: ``mattgs report``, ``history``, ``ui``, ``promote``, ``export``, ``view``.

Light at the top, as ``flows/cli/app.py``, which registers them.
"""

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.arguments import DEFAULT_OUT, Out
from mattgs_ops.errors import InputError

RUN = "A run: its id, the beginning of its id, or its name in `mattgs ui`"
Run = Annotated[str, typer.Argument(help=f"{RUN}.")]
RunOrPly = Annotated[
    str, typer.Argument(metavar="RUN_OR_PLY", help=f"{RUN}; or a PLY file with splats.")
]


def register(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command()(report)
    app.command()(history)
    app.command()(ui)
    app.command()(promote)
    app.command()(export)
    app.command()(view)
    app.command()(compare)


def report(
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="BENCHMARK_OR_ROWS...",
            help="Name of a benchmark that was run; or rows.json files that are parts of one.",
        ),
    ],
    config: Annotated[
        Path | None,
        typer.Option(
            help="With rows files: the benchmark's TOML file. The report then says what of its "
            "grid is missing."
        ),
    ] = None,
    paper_values: Annotated[
        Path | None, typer.Option(help="The paper's own values as a TOML file, to print beside.")
    ] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Build a benchmark's report again: from what MLflow holds, or from files of rows.

    Rows files may come from several runs and machines; what does not belong together is refused.
    """
    if any(name.endswith(".json") for name in what):
        from flows.results.compile_report import compile_report

        files = [Path(name) for name in what]
        made = compile_report(files, out.resolve(), config, paper_values)
    else:
        from flows.results.rebuild import rebuild_report

        if len(what) > 1 or config is not None:
            raise InputError(
                "report: expected the name of one benchmark, or rows.json files (with --config)"
            )
        made = rebuild_report(what[0], out.resolve(), paper_values)
    typer.echo(f"Report: {made}")


def history(
    benchmark: Annotated[str, typer.Argument(help="Name of a benchmark that was run.")],
    out: Out = DEFAULT_OUT,
) -> None:
    """Show how each metric of each cell went over runs and commits, and where it changed for good.

    Writes a page with a chart per metric, the gate's verdicts as marks. A step is a change of level
    beyond the gate's margin that lasted two runs or more; its first commit is named.
    """
    from flows.results.history import show_history

    typer.echo(show_history(benchmark, out.resolve()))


def ui(
    out: Out = DEFAULT_OUT,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port on this machine.")] = 5000,
    browser: Annotated[bool, typer.Option(help="Open the browser on a server.")] = True,
) -> None:
    """Look at all runs in MLflow's web interface.

    Opens the server that MLFLOW_TRACKING_URI names; without one serves the runs of the output
    folder until Ctrl-C.
    """
    from flows.services.mlflow_ui import show

    show(out.resolve(), port, browser=browser)


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
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on this machine; 0 takes a free one.")
    ] = 8080,
    browser: Annotated[bool, typer.Option(help="Open the browser.")] = True,
    out: Out = DEFAULT_OUT,
) -> None:
    r"""Look at splats in the browser, with the cameras and photos of a run, until Ctrl-C.

    Needs the extra `view`: pip install 'mattgs-bench\[view]'.
    """
    from flows.results.view import view as show

    show(run, out.resolve(), port, browser=browser)


def compare(
    first: Annotated[str, typer.Argument(metavar="RUN", help=f"A: {RUN}; or FILE:NAME of rows.")],
    second: Annotated[str, typer.Argument(metavar="RUN", help="B, in the same way.")],
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    out: Out = DEFAULT_OUT,
) -> None:
    """Print a table of two runs of one capture, and open the slider over their test views.

    A row of a file is named as rows.json:rover nobg-ours seed 0.
    """
    import webbrowser

    from flows.results.compare import compare as compare_runs

    table, page = compare_runs(first, second, out.resolve())
    typer.echo(table)
    typer.echo(f"Page: {page}")
    if browser:
        webbrowser.open(page.as_uri())
