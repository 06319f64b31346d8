"""Runs that nobody works on any more, closed as ``KILLED`` instead of running for ever.

A benchmark that is killed leaves its runs open. The same benchmark, started again, goes on in them;
but when sources or settings have changed meanwhile its runs are others, and the old ones would stay
``RUNNING``. A run names its owner (:mod:`tasks.registry.content.owner`) by a tag; what a dead
process of this machine owned is closed.
"""

from typing import Any

from tasks.registry.content import owner
from tasks.registry.project import experiment_name
from tasks.registry.run_of_row import OWNER_TAG


def close_orphans(
    tracking_uri: str, benchmark: str | None = None, *, dry_run: bool = False
) -> list[str]:
    """Close the runs of dead owners, of one benchmark or of all; returns their names.

    With ``dry_run`` only those that would be closed are named.
    """
    from mlflow.tracking import MlflowClient

    client: Any = MlflowClient(tracking_uri=tracking_uri)
    if benchmark is None:
        experiments = [found.experiment_id for found in client.search_experiments()]
    else:
        found = client.get_experiment_by_name(experiment_name(benchmark))
        experiments = [] if found is None else [found.experiment_id]
    closed = []
    for run in _running(client, experiments) if experiments else []:
        if owner.is_dead(run.data.tags[OWNER_TAG]):
            if not dry_run:
                client.set_tag(run.info.run_id, "status", "interrupted")
                client.set_terminated(run.info.run_id, "KILLED")
            closed.append(f"{run.info.run_name} ({run.info.run_id[:8]})")
    return closed


def _running(client: Any, experiments: list[str]) -> list[Any]:
    query = f"attributes.status = 'RUNNING' and tags.`{OWNER_TAG}` != ''"
    found: list[Any] = []
    token = None
    while True:
        page = client.search_runs(experiments, filter_string=query, page_token=token)
        found += page
        token = page.token
        if not token:
            return found
