"""One training of the segmenter in MLflow: a run that is followed step by step while it goes on.

All such trainings are runs of one MLflow experiment, so that their curves can be compared. A
training that goes on from its checkpoint goes on in its run, named by the tag ``mattgs.training``.
"""

import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tasks.registry import run_of_row, runs
from tasks.registry.content import values

EXPERIMENT = "segmenter"


class TrainingRun:
    """A run under way; ``key`` says which training it is."""

    def __init__(
        self, tracking_uri: str, artifacts: Path | None, key: str, parameters: Mapping[str, Any]
    ) -> None:
        from mlflow.tracking import MlflowClient

        runs.initialise(tracking_uri)
        self._client: Any = MlflowClient(tracking_uri=tracking_uri)
        experiment = runs.open_benchmark(tracking_uri, EXPERIMENT, artifacts)
        query = f"tags.`mattgs.training` = '{key}'"
        found = self._client.search_runs([experiment], filter_string=query, max_results=1)
        if found:
            self.id = str(found[0].info.run_id)
        else:
            run = self._client.create_run(
                experiment, tags={"mattgs.training": key}, run_name=f"segmenter {key}"
            )
            self.id = str(run.info.run_id)
            self._log_parameters(parameters)
        run_of_row.open_run(self._client, self.id)

    def log(self, step: int, numbers: Mapping[str, float]) -> None:
        """Add the metrics of one step, in one call."""
        from mlflow.entities import Metric

        now = time.time_ns() // 1_000_000
        metrics = [Metric(key, float(value), now, step) for key, value in numbers.items()]
        self._client.log_batch(self.id, metrics=metrics)

    def end(self, status: str, files: Iterable[Path] = ()) -> None:
        """Keep files and close the run as ``FINISHED`` or ``FAILED``."""
        for path in files:
            self._client.log_artifact(self.id, str(path))
        self._client.set_terminated(self.id, status)

    def _log_parameters(self, parameters: Mapping[str, Any]) -> None:
        from mlflow.entities import Param

        flat = values.flatten(parameters)
        self._client.log_batch(self.id, params=[Param(key, text) for key, text in flat.items()])
