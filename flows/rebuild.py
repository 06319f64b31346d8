"""A benchmark's report, built again from the registry and nothing else."""

import tempfile
from pathlib import Path

from flows import embedded
from tasks import registry_promotion, registry_summary


def rebuild_report(benchmark: str, out: Path) -> Path:
    """Build the report below ``out`` from MLflow's runs and their files; return its path.

    Neither the store nor what an earlier report left is read. Raises :class:`InputError` when the
    registry does not know the benchmark.
    """
    from reports.build import build

    embedded.quieten(out)
    tracking = embedded.tracking_uri(out)
    rows = registry_summary.report_rows(tracking, benchmark)
    with tempfile.TemporaryDirectory(prefix="mattgs-report-") as folder:
        return build(
            rows,
            out / "benchmarks" / benchmark,
            title=f"Benchmark {benchmark}",
            artifacts_root=registry_summary.fetch(tracking, rows, Path(folder)),
            baselines=registry_promotion.aliased_rows(tracking, benchmark),
        )
