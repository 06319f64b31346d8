"""``mattgs``: the command line. Light at the top: every command imports what it needs itself."""

import errno
import logging
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn

import typer

from flows.cli import gate, operate, results
from flows.cli.arguments import (
    DEFAULT_OUT,
    EXIT_FAILED,
    NamedPhotos,
    Out,
    Photos,
    end_with,
    exit_with,
    of_a_disk,
    of_mlflow,
    one_folder,
    replace_what_cannot_be_printed,
)
from flows.cli.making import captures, segment
from mattgs_ops.errors import InputError, MattgsError

AGAIN_SECONDS = 0.05  # after which a Ctrl-C that was dropped comes again
EXIT_INPUT, EXIT_EXPERIMENTS = 2, 3
EXIT_INTERRUPTED, EXIT_TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM  # as shells say it

app = typer.Typer(
    help="Benchmark masked, attention-weighted 3D Gaussian Splatting against plain 3DGS on a CPU.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from tasks.stages.stage import own_version

        typer.echo(f"mattgs {own_version()}")
        raise typer.Exit


@app.callback()
def options_of_all(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Hold the options that stand before any command; Typer acts on them itself."""
    del version


@app.command()
def run(
    photos: Photos = None,
    named: NamedPhotos = None,
    config: Annotated[
        Path | None, typer.Option(help="Benchmark as a TOML file; other options override it.")
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

    Exit codes: 0 all finished, 1 a service or the disk failed (the same command goes on), 2 the
    input cannot be used, 3 experiments failed (the report says why), 130 interrupted.
    """
    from flows.cli import options
    from flows.cli.run import run_benchmark

    merged = options.benchmark_config(
        config,
        {
            "photos": one_folder("run", photos, named),
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
    photos: Photos = None,
    named: NamedPhotos = None,
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

    Prints of each capture what is wrong, how many photos will probably get a camera, and what a run
    will take; writes a sheet of the masks. Exit code 2: one that a run could not work with.
    """
    from flows.cli import options
    from flows.cli.check import check as look
    from mattgs_ops.capture.photos import mark_output

    photos = one_folder("check", photos, named)
    given = {"photos": photos, "capture": capture, "masks": masks}
    merged = options.benchmark_config(config, given)
    if photos is None and capture is None and config is None:
        raise InputError("check: expected a folder of photos, or --capture")
    mark_output(out)
    if not look(merged, out.resolve() / "checks"):
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
captures.register(app)
segment.register(app)


@contextmanager
def _heeding_interrupts() -> Iterator[set[int]]:
    """Have Ctrl-C end the program wherever it is, and SIGTERM as Ctrl-C does; yield what came.

    Batch systems and containers end what they run by SIGTERM. Python drops and prints what is
    raised in a callback of the garbage collector, of which Dask and SQLAlchemy have some: what came
    there is sent again as Ctrl-C, by an alarm, which needs no lock.
    """
    before = sys.unraisablehook, signal.getsignal(signal.SIGALRM), signal.getsignal(signal.SIGTERM)
    came: set[int] = set()

    def interrupt(number: int, _: FrameType | None) -> None:
        came.add(number)
        raise KeyboardInterrupt

    def dropped(unraisable: "sys.UnraisableHookArgs") -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, AGAIN_SECONDS)
        else:
            before[0](unraisable)

    def send_again(_: int, frame: FrameType | None) -> None:
        while frame:
            if frame.f_code is dropped.__code__:  # what is raised there is dropped for good
                signal.setitimer(signal.ITIMER_REAL, AGAIN_SECONDS)
                return
            frame = frame.f_back
        signal.raise_signal(signal.SIGINT)

    signal.signal(signal.SIGALRM, send_again)
    signal.signal(signal.SIGTERM, interrupt)
    sys.unraisablehook = dropped
    try:
        yield came
    finally:
        sys.unraisablehook = before[0]
        signal.setitimer(signal.ITIMER_REAL, 0)  # with what was there before it ends the process
        signal.signal(signal.SIGALRM, before[1])
        signal.signal(signal.SIGTERM, before[2])


def main() -> None:
    """Entry of ``mattgs``: errors a person can act on, without tracebacks."""
    replace_what_cannot_be_printed()
    try:
        with _heeding_interrupts() as came:
            app()
    except InputError as error:
        end_with(error, EXIT_INPUT)
    except MattgsError as error:
        end_with(error, EXIT_FAILED)
    except OSError as error:
        told = of_a_disk(error)
        if told is not None:
            end_with(told, EXIT_FAILED)
        if error.filename is None:  # of no file that somebody could see to
            raise
        in_the_way = error.errno == errno.EEXIST  # of a folder that was to be made
        reason = "expected a folder, found a file" if in_the_way else error.strerror
        end_with(f"{error.filename}: {reason}", EXIT_INPUT)
    except Exception as error:
        told = of_mlflow(error)
        if told is None:
            raise
        end_with(told, EXIT_FAILED)
    except (SystemExit, KeyboardInterrupt) as ended:
        if isinstance(ended, SystemExit) and ended.code != EXIT_INTERRUPTED:
            raise  # that code is what Typer makes of Ctrl-C, without a word
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a further one would break off the exit
        logging.disable()  # what Prefect could not bring to its end, it would tell at length
        _end_interrupted(terminated=signal.SIGTERM in came)


def _end_interrupted(*, terminated: bool) -> NoReturn:
    """End the process, and say so."""
    how = "ended by SIGTERM" if terminated else "interrupted"
    sys.stderr.write(f"mattgs: {how}; the same command goes on from here\n")
    exit_with(EXIT_TERMINATED if terminated else EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
