"""``mattgs``: the command line. Light at the top: every command imports what it needs itself."""

import errno
import sys
from pathlib import Path
from typing import Annotated

import typer

from flows.cli import gate, operate, results
from flows.cli.arguments import DEFAULT_OUT, Out
from mattgs_ops.errors import InputError, MattgsError

EXIT_FAILED, EXIT_INPUT, EXIT_EXPERIMENTS, EXIT_INTERRUPTED = 1, 2, 3, 130

app = typer.Typer(
    help="Benchmark masked, attention-weighted 3D Gaussian Splatting against plain 3DGS on a CPU.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command()
def run(
    config: Annotated[
        Path | None, typer.Option(help="Benchmark as a TOML file; other options override it.")
    ] = None,
    photos: Annotated[
        Path | None, typer.Option(help="A folder of photos of one object, from all sides.")
    ] = None,
    capture: Annotated[
        Path | None,
        typer.Option(
            help="A COLMAP project, nerfstudio's transforms.json or NeRF's transforms_train.json."
        ),
    ] = None,
    video: Annotated[
        Path | None, typer.Option(help="A video of one object; sharp frames become the photos.")
    ] = None,
    frames: Annotated[int | None, typer.Option(help="Photos taken from the video.")] = None,
    captures: Annotated[
        str | None, typer.Option(help="Bundled captures, for example rover,hexapod.")
    ] = None,
    masks: Annotated[
        Path | None, typer.Option(help="Your own masks for the photos, 255 = object.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the benchmark, and of your capture.")
    ] = None,
    conditions: Annotated[
        str | None, typer.Option(help="For example original-3dgs,nobg-ours.")
    ] = None,
    seeds: Annotated[str | None, typer.Option(help="For example 0,1,2.")] = None,
    iterations: Annotated[int | None, typer.Option(help="Training steps.")] = None,
    resolution: Annotated[
        int | None, typer.Option(help="Longest side of training views, in pixels.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Stages at a time; by default one per core.")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="Threads of one training.")] = None,
    dask_scheduler: Annotated[
        str | None, typer.Option(help="Use this Dask scheduler, tcp://HOST:PORT or tls://….")
    ] = None,
    dask_certificates: Annotated[
        Path | None, typer.Option(help="Folder with ca.pem, cert.pem and key.pem for tls://.")
    ] = None,
    store: Annotated[
        str | None, typer.Option(help="Share finished stages there: s3://BUCKET/FOLDER, file://…")
    ] = None,
    notify: Annotated[
        str | None,
        typer.Option(help="Message on failure: TYPE/NAME of a Prefect block, or a URL."),
    ] = None,
    remeasure: Annotated[
        bool,
        typer.Option("--remeasure", help="Measure speed anew, also where it is known."),
    ] = False,
    out: Out = DEFAULT_OUT,
) -> None:
    """Run a benchmark: photos in, tables out.

    Without options: the bundled captures at a quick setting. What was finished before is not
    repeated, and a run that was interrupted goes on where it was.

    Exit codes: 0 all finished, 2 the input cannot be used, 3 experiments failed (the report says
    why), 130 interrupted.
    """
    from flows.cli import options
    from flows.cli.run import run_benchmark

    merged = options.benchmark_config(
        config,
        {
            "photos": photos,
            "capture": capture,
            "video": video,
            "frames": frames,
            "captures": options.words(captures),
            "masks": masks,
            "name": name,
            "conditions": options.words(conditions),
            "seeds": options.numbers(seeds, "--seeds"),
            "iterations": iterations,
            "resolution": resolution,
            "workers": workers,
            "threads": threads,
            "dask_scheduler": dask_scheduler,
            "dask_certificates": dask_certificates,
            "store": store,
            "notify": notify,
        },
    )
    if not run_benchmark(merged, out.resolve(), remeasure=remeasure):
        raise typer.Exit(EXIT_EXPERIMENTS)


@app.command()
def check(
    photos: Annotated[
        Path | None, typer.Argument(help="A folder of photos of one object, from all sides.")
    ] = None,
    capture: Annotated[
        Path | None,
        typer.Option(
            help="A COLMAP project, nerfstudio's transforms.json or NeRF's transforms_train.json."
        ),
    ] = None,
    masks: Annotated[
        Path | None, typer.Option(help="Your own masks for the photos, 255 = object.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Benchmark as a TOML file, whose settings are to be used.")
    ] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Look at photos and masks before a long run: about a second a photo.

    Prints what is wrong, how many photos will probably get a camera, and what a run will take;
    writes a sheet of the masks. Exit code 2: there is nothing that a run could work with.
    """
    from flows.cli import options
    from flows.cli.check import check as look

    given = {"photos": photos, "capture": capture, "masks": masks}
    merged = options.benchmark_config(config, given)
    if photos is None and capture is None and config is None:
        raise InputError("check: expected a folder of photos, or --capture")
    if not look(merged, out.resolve() / "checks" / merged.captures[0].name):
        raise typer.Exit(EXIT_INPUT)


@app.command()
def status(
    benchmark: Annotated[str | None, typer.Argument(help="Name; by default all.")] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Show what every stage of a benchmark is doing, or how it ended."""
    from flows.cli.status import print_status

    print_status(out.resolve(), benchmark)


gate.register(app)
operate.register(app)
results.register(app)

captures_app = typer.Typer(help="Captures that come with the project.", no_args_is_help=True)
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

    Three objects on six grounds, by which some bounds were chosen, and five sets that only judge.

    What is there is kept: a later call adds views or sets (needs the extra `captures`).
    """
    from flows.cli.options import words
    from flows.cli.terminal import bar
    from mattgs_ops.synthetic import evaluation_sets

    with bar("render evaluation sets") as progress:
        names = words(sets) or evaluation_sets.NAMES
        evaluation_sets.render_sets(out, names, views=views, progress=progress)
    typer.echo(f"Evaluation sets: {out.resolve()}")


segment_app = typer.Typer(help="The network that cuts objects out.", no_args_is_help=True)
app.add_typer(segment_app, name="segment")


@segment_app.command("train")
def train_segmenter(
    folder: Annotated[Path, typer.Argument(help="Folder for weights, curve and ONNX file.")],
    config: Annotated[Path | None, typer.Option(help="Training as a TOML file.")] = None,
    start_from: Annotated[
        Path | None, typer.Option(help="Weights (.pth) to go on from.", exists=True, dir_okay=False)
    ] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Train U²-Net, with its curve in MLflow, and export it to ONNX.

    An interrupted training goes on from its checkpoint. `segment.model` takes the ONNX file.
    """
    from flows.cli.terminal import bar
    from flows.services import embedded
    from mattgs_ops.segment.network.train_config import SegmentTrainConfig, load_train_config
    from tasks.train_segmenter import train_segmenter as train

    settings = SegmentTrainConfig() if config is None else load_train_config(config)
    if start_from is not None:
        settings = settings.model_copy(update={"start_from": start_from})
    embedded.quieten(out)
    with bar("train U²-Net") as progress:
        onnx = train(settings, folder, embedded.tracking_uri(out), out, progress=progress)
    typer.echo(f"Segmenter: {onnx.resolve()}")


@segment_app.command("combine")
def combine_segmenters(
    onnx: Annotated[Path, typer.Argument(help="The ONNX file to write.")],
    networks: Annotated[
        list[Path], typer.Argument(help="Two or more ONNX files.", exists=True, dir_okay=False)
    ],
) -> None:
    """Make one ONNX file of several networks: it gives the mean of their maps."""
    from mattgs_ops.segment.network.ensemble import combine

    difference = combine(networks, onnx)
    typer.echo(f"Segmenter: {onnx.resolve()} (within {difference:.1g} of the mean)")


def main() -> None:
    """Entry of ``mattgs``: errors a person can act on, without tracebacks."""
    try:
        app()
    except InputError as error:
        sys.stderr.write(f"mattgs: {error}\n")
        sys.exit(EXIT_INPUT)
    except MattgsError as error:
        sys.stderr.write(f"mattgs: {error}\n")
        sys.exit(EXIT_FAILED)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        sys.stderr.write(f"mattgs: {error}: make room; the same command goes on from here\n")
        sys.exit(EXIT_FAILED)
    except SystemExit as ended:
        if ended.code == EXIT_INTERRUPTED:  # what Typer makes of Ctrl-C, without a word
            sys.stderr.write("mattgs: interrupted; the same command goes on from here\n")
        raise


if __name__ == "__main__":
    main()
