"""``mattgs captures …``. Light at the top, as ``flows/cli/app.py``, which registers them."""

from pathlib import Path
from typing import Annotated

import typer

captures_app = typer.Typer(help="Captures that come with the project.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.add_typer(captures_app, name="captures")


@captures_app.command("render")
def render(
    name: Annotated[str, typer.Argument(help="rover, hexapod, lattepanda or desk_extra.")],
    out: Annotated[Path, typer.Option(help="Folder to make, or to go on with.")],
    views: Annotated[int, typer.Option(help="Number of training photos.")] = 48,
    test_views: Annotated[int, typer.Option(help="Number of further photos to test with.")] = 24,
    resolution: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "800x600",
    samples: Annotated[
        int | None, typer.Option(help="Light paths per pixel; more is less noisy.")
    ] = None,
    test_samples: Annotated[int | None, typer.Option(help="The same for test photos.")] = None,
    seed: Annotated[int, typer.Option(help="Another seed, another desk and walk.")] = 0,
) -> None:
    """Render a capture: photos, masks and cameras (needs the extra `captures`).

    The same command after an interruption goes on with the next view.
    """
    from flows.cli.options import size
    from flows.cli.terminal import bar
    from mattgs_ops.synthetic import render as rendering

    width, height = size(resolution, "--resolution")
    making = rendering.Making(
        name,
        seed=seed,
        views=views,
        test_views=test_views,
        width=width,
        height=height,
        samples=rendering.SAMPLES if samples is None else samples,
        test_samples=rendering.TEST_SAMPLES if test_samples is None else test_samples,
    )
    with bar(f"render {name}") as progress:
        rendering.render_capture(making, out, progress=progress)
    typer.echo(f"Capture: {out.resolve()}")


@captures_app.command("evaluation")
def render_evaluation(
    out: Annotated[Path, typer.Argument(help="Folder of the sets, one capture each.")],
    sets: Annotated[str | None, typer.Option(help="Some of them, OBJECT-GROUND,…")] = None,
    views: Annotated[int, typer.Option(help="48, 24 or 12 of each walk.")] = 48,
) -> None:
    """Render the evaluation sets for masks: objects on grounds, with exact masks.

    Objects on grounds by which some bounds were chosen, and six sets that only judge.

    What is there is kept: a later call adds views or sets (needs the extra `captures`).
    """
    from flows.cli.options import words
    from flows.cli.terminal import bar
    from mattgs_ops.synthetic import evaluation_sets

    with bar("render evaluation sets") as progress:
        names = words(sets) or evaluation_sets.NAMES
        evaluation_sets.render_sets(out, names, views=views, progress=progress)
    typer.echo(f"Evaluation sets: {out.resolve()}")
