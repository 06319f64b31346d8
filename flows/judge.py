"""Compare a recorded benchmark with a baseline, and make baselines of recorded benchmarks."""

from pathlib import Path

from mattgs_ops.errors import InputError
from reports import baseline, gate_output
from reports.gate import compare
from reports.rows import Row, read_rows


def judge(out: Path, benchmark: str, against: str, *, strict: bool = False) -> tuple[str, int]:
    """Return what to print and what to exit with; writes ``gate.md``, ``.xml`` and ``.json``.

    ``against`` is a baseline's path or the name of a committed one. Raises :class:`InputError`
    naming the file that cannot be used.
    """
    known = baseline.load(against)
    report = compare(recorded(out, benchmark), known.rows, noise=known.noise, strict=strict)
    folder = out / "benchmarks" / benchmark / "gate"
    gate_output.write(report, folder)
    return f"{gate_output.terminal(report)}\nGate: {folder}", report.exit_code


def make_baseline(out: Path, benchmark: str, file: Path) -> Path:
    """Write a recorded benchmark's rows as a baseline; returns the file's path."""
    baseline.make(recorded(out, benchmark), benchmark).save(file)
    return file


def recorded(out: Path, benchmark: str) -> list[Row]:
    """Return a benchmark's rows; raises :class:`InputError` when it was never run."""
    path = out / "benchmarks" / benchmark / "rows.json"
    if not path.is_file():
        raise InputError(f"{path}: expected the rows of the benchmark {benchmark!r}, found none")
    return read_rows(path)
