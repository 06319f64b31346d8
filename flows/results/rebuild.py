"""A benchmark's report, built again from the registry and nothing else."""

import tempfile
from pathlib import Path

from flows.services import embedded, registries
from mattgs_ops.naming import checked_name
from tasks.registry import promotion, summary


def rebuild_report(benchmark: str, out: Path, paper_values: Path | None = None) -> Path:
    """Build the report below ``out`` from MLflow's runs and their files; return its path.

    Neither the store nor what an earlier report left is read. ``paper_values`` names a file of the
    paper's own values, in the format of ``reports/tables/paper_values.toml``. Raises
    :class:`InputError` when that file cannot be used, and when the registry does not know the
    benchmark.
    """
    from reports.page.build import build
    from reports.rows.merge import newest_alike
    from reports.tables import paper

    checked_name(benchmark, "the benchmark's name")
    values = None if paper_values is None else paper.load(paper_values)
    embedded.enter_existing(out)
    tracking = registries.current(out)
    recorded = summary.report_rows(tracking, benchmark)
    rows, left_out = newest_alike(recorded)
    others = summary.not_reported(tracking, benchmark, recorded)
    if others:
        what = "experiment is" if others == 1 else "experiments are"
        left_out.append(
            f"{others} recorded {what} left out: the newest run of the benchmark did not have them."
        )
    with tempfile.TemporaryDirectory(prefix="mattgs-report-") as folder:
        return build(
            rows,
            out / "benchmarks" / benchmark,
            title=f"Benchmark {benchmark}",
            artifacts_root=summary.fetch(tracking, rows, Path(folder)),
            baselines=promotion.aliased_rows(tracking, benchmark),
            values=values,
            notes=left_out,
        )
