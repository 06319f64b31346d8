"""Find a run by what people call it: its id, the beginning of its id, or its name."""

from dataclasses import dataclass
from typing import Any

from mattgs_ops.errors import InputError
from tasks.registry.project import benchmark_name, is_ours
from tasks.registry.run_of_row import ROW_TAG

FEWEST_LETTERS = 4  # of an id: shorter beginnings are too easily another run's
SHOWN = 8  # candidates that an error names


@dataclass(frozen=True)
class Found:
    """A run of an experiment, and the benchmark that it belongs to."""

    run_id: str
    name: str
    benchmark: str

    def __str__(self) -> str:
        return f"{self.run_id[:8]} ({self.name}, {self.benchmark})"


def find_run(tracking_uri: str, text: str) -> Found:
    """Return the one run that ``text`` means.

    Raises :class:`InputError` when no run, or more than one, answers to it; names the candidates.
    """
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    all_of_them = client.search_experiments()
    names = {e.experiment_id: benchmark_name(e.name) for e in all_of_them if is_ours(e.name)}
    quoted = text.replace("'", "")
    queries = [f"attributes.run_name = '{quoted}'"]
    if len(text) >= FEWEST_LETTERS and text.isalnum():
        queries.append(f"attributes.run_id LIKE '{text.lower()}%'")
    found: dict[str, Found] = {}
    for query in queries:
        for run in client.search_runs(list(names), filter_string=query, max_results=100):
            if ROW_TAG in run.data.tags:
                benchmark = names[run.info.experiment_id]
                found[run.info.run_id] = Found(run.info.run_id, run.info.run_name, benchmark)
    if len(found) == 1:
        return next(iter(found.values()))
    if not found:
        raise InputError(
            f"run {text!r}: expected a run's id, the first {FEWEST_LETTERS} letters of it at "
            "least, or a run's name as `mattgs ui` shows it; found no such run"
        )
    some = "; ".join(str(one) for one in list(found.values())[:SHOWN])
    raise InputError(f"run {text!r}: expected one run, found {len(found)}: {some}; give the id")
