"""Compare a recorded benchmark with a baseline, and make baselines of recorded benchmarks."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flows import run_record
from flows.services import embedded, registries
from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_name
from reports.gate import baseline, output, pictures
from reports.gate.baseline import Baseline
from reports.gate.compare import compare
from reports.gate.findings import Exit, GateReport
from reports.gate.planted import sensitivity
from reports.gate.tolerances import Doubt
from reports.history.marks import verdicts_by_run
from reports.rows.schema import Row, read_rows


def judge(
    out: Path,
    benchmark: str,
    against: str,
    *,
    doubt: Doubt = Doubt.MARGIN,
    must_see: bool = False,
    run: str | None = None,
) -> tuple[str, int]:
    """Return what to print and what to exit with.

    ``run`` names the run whose rows these must be, by its record; rows of a run that has not ended,
    broke off, or is another one are not judged: failed runs.
    With ``must_see`` a gate that does not name every loss planted into its own baseline cannot
    judge.
    Writes ``gate.md``, ``.xml`` and ``.json``, and pictures of the views that lost most.
    ``against`` is a baseline's path, the name of a committed one, or an alias in the registry.
    Raises :class:`InputError` naming the file that cannot be used.
    """
    checked_name(benchmark, "the benchmark's name")
    if not out.is_dir():
        raise InputError(f"{out}: expected the folder of a run, found none; --out names it")
    embedded.enter(out)
    wrong = run_record.problem(out / "benchmarks" / benchmark, run)
    if wrong:
        return f"Gate: failed runs. {benchmark}: {wrong}", Exit.FAILED_RUNS
    reference = find_baseline(out, benchmark, against)
    rows = recorded(out, benchmark)
    report = compare(rows, reference.rows, noise=reference.noise, doubt=doubt)
    planted = sensitivity(reference.rows, reference.noise)
    blind = must_see and not planted.complete and report.exit_code == Exit.PASS
    code = Exit.CANNOT_JUDGE if blind else report.exit_code
    report = replace(report, planted=planted, exit_code=code)
    folder = out / "benchmarks" / benchmark / "gate"
    for old in folder.glob("gate-*.png"):
        old.unlink()
    store = out / "store"
    drawn = pictures.draw(report, rows, store, folder, baseline=reference.rows, baseline_root=store)
    output.write(report, folder, drawn)
    _remember(out, against, report, rows)
    return f"{output.terminal(report)}\nGate: {folder}", report.exit_code


def _remember(out: Path, against: str, report: GateReport, rows: Sequence[Row]) -> None:
    """Tag the rows' runs in the registry with their verdicts, for ``mattgs history``.

    Only where there is a registry: rows may come from elsewhere.
    """
    from tasks.registry.content import history

    uri, verdicts = registries.existing(out), verdicts_by_run(report, rows)
    if verdicts and uri is not None:
        history.record_verdicts(uri, Path(against).stem, verdicts)


def find_baseline(out: Path, benchmark: str, against: str) -> Baseline:
    """Return the baseline of a file or committed name, else of an alias in the registry.

    The rows of an alias are those of the benchmark's runs that ``mattgs promote`` gave it to.
    Raises :class:`InputError` naming what was looked for.
    """
    if Path(against).suffix or Path(against).is_file() or baseline.committed(against):
        return baseline.load(against)
    from tasks.registry import promotion

    uri = registries.existing(out)
    rows = [] if uri is None else promotion.aliased_rows(uri, benchmark, against)
    if not rows:
        raise InputError(
            f"{against}: expected a baseline's file, the name of a committed one, or an alias that "
            f"runs of the benchmark {benchmark!r} were promoted to; found none"
        )
    return baseline.make(rows, f"{benchmark}@{against}")


def make_baseline(
    out: Path, benchmark: str, file: Path, again: Sequence[Path] = ()
) -> tuple[Path, int]:
    """Write a recorded benchmark's rows as a baseline; returns its path, and how many rows failed.

    Its noise is measured between these rows and those of ``again``, runs of the same code; without
    them a baseline of the same benchmark that is replaced hands on its own.
    """
    wrong = run_record.problem(out / "benchmarks" / benchmark)
    if wrong:
        raise InputError(f"{benchmark}: expected the rows of a run that ended: {wrong}")
    rows = recorded(out, benchmark)
    if again:
        noise = baseline.measured_noise([rows, *(read_rows(path) for path in again)])
    else:
        noise = baseline.kept_noise(file, benchmark)
    baseline.make(rows, benchmark, noise).save(file)
    return file, sum(row["status"] == "failed" for row in rows)


def recorded(out: Path, benchmark: str) -> list[Row]:
    """Return a benchmark's rows; raises :class:`InputError` when it was never run."""
    path = out / "benchmarks" / checked_name(benchmark, "the benchmark's name") / "rows.json"
    if not path.is_file():
        raise InputError(f"{path}: expected the rows of the benchmark {benchmark!r}, found none")
    return read_rows(path)
