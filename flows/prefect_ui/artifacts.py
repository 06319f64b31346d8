"""What Prefect's interface shows of a benchmark: how far it is, its tables, where its report lies.

Keys carry the benchmark's name, so that the interface keeps each benchmark's history apart. No
result depends on them: an error of the server costs a warning.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast
from uuid import UUID

from prefect.artifacts import (
    create_link_artifact,
    create_markdown_artifact,
    create_progress_artifact,
    update_progress_artifact,
)

from mattgs_ops.naming import slug
from mattgs_ops.progress import Throttle
from reports.rows.schema import Row
from reports.tables import formats
from reports.tables.side_tables import all_tables
from tasks.stages.stage import Cell

NO_ADDRESS = """The report is the file `{}`.

No server has it, so there is no link: `mattgs serve` has reports, an MLflow server has them
(`MLFLOW_TRACKING_URI`), and `MATTGS_REPORTS_URL` names another address of `benchmarks/`."""
PROGRESS_SECONDS = 5.0  # between two updates of a progress bar: each is an API call


class ProgressBar:
    """Experiments that have ended, as a bar."""

    def __init__(self, name: str, total: int) -> None:
        self._total = total
        self._name = name
        self._throttle = Throttle(PROGRESS_SECONDS)
        self._id: UUID | None = None
        key = _key("progress", name)
        with _only_warned():
            made = create_progress_artifact(0.0, key=key, description=self._text(0, 0))
            self._id = cast(UUID, made)  # not a coroutine: no event loop runs here

    def update(self, done: int, failed: int) -> None:
        """Say how many experiments have ended, and how many of them failed."""
        if self._id is not None and self._throttle.passes(done, self._total):
            share = 100.0 * done / self._total
            with _only_warned():
                update_progress_artifact(self._id, share, description=self._text(done, failed))

    def _text(self, done: int, failed: int) -> str:
        text = f"{self._name}: {done} of {self._total} experiments"
        return f"{text}, {failed} failed" if failed else text


def publish_dashboard(name: str, address: str) -> None:
    """Link to the dashboard of the Dask cluster that runs the stages."""
    with _only_warned():
        create_link_artifact(
            address,
            link_text="Dask dashboard",
            key=_key("dask", name),
            description=f"What Dask's workers do while {name} runs",
        )


def publish_results(name: str, rows: list[Row], report: Path, address: str | None) -> None:
    """Publish the tables, the reasons of failures, and where the report is.

    The link leads to ``address``, a page on a server. Without one there is no link, as browsers do
    not follow one from a server to a file: the text names the file and says what serves it.
    """
    parts = [formats.markdown(table) for table in all_tables(rows)]
    failed = [row for row in rows if row["status"] == "failed"]
    if failed:
        lines = [f"- {Cell.of(r)}: {r['reason']}" for r in failed]
        parts.append("\n".join(["**Failed**", "", *lines]))
    with _only_warned():
        create_markdown_artifact(
            "\n\n".join(parts), key=_key("tables", name), description=f"Tables of {name}"
        )
    key, text = _key("report", name), f"{len(rows)} experiments, {len(failed)} failed"
    with _only_warned():
        if address is None:
            create_markdown_artifact(NO_ADDRESS.format(report.resolve()), key=key, description=text)
        else:
            create_link_artifact(
                address,
                link_text=f"Report of {name}",
                key=key,
                description=f"{text}; {report.resolve()}",
            )


@contextmanager
def _only_warned() -> Iterator[None]:
    try:
        yield
    except Exception as error:  # whatever the server or the way to it raise
        logging.getLogger("mattgs").warning("Prefect's interface got nothing: %s", error)


def _key(kind: str, name: str) -> str:
    """Return the key of an artifact: letters, digits and dashes, as Prefect wants keys."""
    return f"{kind}-{slug(name.lower(), keep='').strip('-')}"
