"""The gate tried on this machine: the same code run twice, resampled into many A/A comparisons."""

from pathlib import Path

from flows.cli.run import run_benchmark
from flows.gate import recorded
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.config_file import load_toml
from reports.gate import self_check
from reports.gate.findings import Exit

FOLDER = "self-check"
RUNS = ("a", "b")


def check(config: Path | None, out: Path, comparisons: int) -> tuple[str, int]:
    """Run the benchmark twice, nothing shared, and judge the gate by it; returns text and code.

    Raises :class:`InputError` for a configuration that cannot be used.
    """
    settings = BenchmarkConfig() if config is None else load_toml(config)
    runs = []
    for name in RUNS:
        place = out / FOLDER / name  # a store of its own: a stage found there would be no new run
        if not run_benchmark(settings, place, died=Exit.FAILED_RUNS):
            return f"Self-check: experiments failed; see {place}", Exit.FAILED_RUNS
        runs.append(recorded(place, settings.name))
    outcome = self_check.self_check(runs, comparisons=comparisons)
    return self_check.markdown(outcome), Exit.PASS if outcome.trusted else Exit.REGRESSION
