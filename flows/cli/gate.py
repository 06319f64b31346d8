"""``mattgs gate`` and ``mattgs baseline``. Registered by ``cli.py``; light at the top like it."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from flows.cli.arguments import DEFAULT_OUT, EXIT_FAILED, Out, of_mlflow
from mattgs_ops.errors import InputError, StageError
from reports.gate.tolerances import Doubt

DEFAULT_BENCHMARK = "quick"

Config = Annotated[Path | None, typer.Option(help="Benchmark as a TOML file; it is run first.")]
Benchmark = Annotated[
    str | None,
    typer.Option(help=f"Name of a benchmark that was run; by default {DEFAULT_BENCHMARK}."),
]


def register(app: typer.Typer) -> None:
    """Add both commands to ``app``."""
    app.command()(gate)
    app.command()(baseline)


def gate(
    against: Annotated[
        str | None,
        typer.Option(
            "--baseline",
            metavar="FILE_OR_ALIAS",
            help="A baseline's file, the name of a committed one, or an alias in the registry.",
        ),
    ] = None,
    benchmark: Benchmark = None,
    config: Config = None,
    self_check: Annotated[
        bool,
        typer.Option(
            "--self-check", help="Run the same code twice and say how often the gate errs."
        ),
    ] = False,
    comparisons: Annotated[
        int, typer.Option(min=1, help="Resampled comparisons of the self-check.")
    ] = 200,
    doubt: Annotated[
        Doubt,
        typer.Option(
            help="Inconclusive numbers that cannot be judged: all, those that look like a loss "
            "beyond their margin, or none."
        ),
    ] = Doubt.MARGIN,
    run: Annotated[
        str | None,
        typer.Option(help="The run that must have written the rows, as run.json calls it."),
    ] = None,
    must_see: Annotated[
        bool,
        typer.Option(
            "--must-see",
            help="Cannot judge (2) unless each loss planted into the baseline's rows is named.",
        ),
    ] = False,
    out: Out = DEFAULT_OUT,
) -> None:
    """Compare a benchmark with a baseline; for CI.

    Exit codes: 0 pass; 1 regression: a number is worse; 2 cannot judge: a number is not comparable
    or in doubt, or the input cannot be used; 3 failed runs. With --self-check: 0 the gate may be
    trusted on such runs, 1 it may not, 2 the input cannot be used, 3 failed runs.
    """
    if self_check:
        if against is not None or benchmark is not None:
            raise InputError("--self-check: goes with --config only; it compares runs of its own")
    elif against is None:
        raise InputError("--baseline: expected a file, a name or an alias (or --self-check)")

    def judged() -> tuple[str, int]:
        from flows.gate import judge
        from flows.gate_self_check import check
        from reports.gate.findings import Exit

        if against is None:
            return check(config, out.resolve(), comparisons)
        name = _named(benchmark, config, out, died=Exit.FAILED_RUNS)
        return judge(out.resolve(), name, against, doubt=doubt, must_see=must_see, run=run)

    text, code = _whatever_comes(judged)
    typer.echo(text)
    raise typer.Exit(code)


def _whatever_comes(judged: Callable[[], tuple[str, int]]) -> tuple[str, int]:
    """Return what was judged; after an error nothing was, which is never a regression."""
    from reports.gate.findings import Exit

    try:
        return judged()
    except InputError:
        raise
    except (StageError, OSError) as error:
        return f"mattgs: {error}", Exit.CANNOT_JUDGE
    except Exception as error:  # Python would end with 1, which is the code of a regression
        broke = f"the gate itself broke\n{traceback.format_exc()}"
        return f"mattgs: {of_mlflow(error) or broke}", Exit.CANNOT_JUDGE


def baseline(
    file: Annotated[Path, typer.Argument(help="JSON file to write.")],
    benchmark: Benchmark = None,
    config: Config = None,
    again: Annotated[
        list[Path] | None,
        typer.Option(
            help="Rows (rows.json) of another run of the same code; repeat for more. How they "
            "differ becomes the baseline's noise. Without them a file that is there keeps its own."
        ),
    ] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Make a baseline of a benchmark's rows, for the gate."""
    from flows import gate as judge

    name = _named(benchmark, config, out)
    made, failed = judge.make_baseline(out.resolve(), name, file, again or [])
    if failed:
        noun = "experiment" if failed == 1 else "experiments"
        typer.echo(f"{failed} {noun} failed; the gate expects that.", err=True)
    typer.echo(f"Baseline: {made.resolve()}")


def _named(
    benchmark: str | None, config: Path | None, out: Path, *, died: int = EXIT_FAILED
) -> str:
    """Return the benchmark to look at; with ``config`` it is run before.

    ``died`` is what to exit with where a service ends meanwhile.
    """
    if config is None:
        return benchmark or DEFAULT_BENCHMARK
    if benchmark is not None:
        raise InputError("--benchmark and --config: give one of them")
    from flows.cli.run import run_benchmark
    from mattgs_ops.config_file import load_toml

    settings = load_toml(config)
    # failed experiments are rows, and judged as such
    run_benchmark(settings, out.resolve(), died=died)
    return settings.name
