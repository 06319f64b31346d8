"""What Prefect's interface shows of a benchmark: how far it is, its tables, where its report lies.

Keys carry the benchmark's name, so that the interface keeps each benchmark's history apart. They
serve people only: a server that does not take them costs nothing but a warning.
"""

import logging
import time
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

from reports.rows.schema import Row
from reports.tables import formats
from reports.tables.side_tables import all_tables

PROGRESS_SECONDS = 5.0  # an update is an API call: at most one in this time


class ShownProgress:
    """Experiments that have ended, as a bar."""

    def __init__(self, name: str, total: int) -> None:
        self._total = total
        self._name = name
        self._shown = time.monotonic()
        self._id: UUID | None = None
        key = f"progress-{slug(name)}"
        with _only_warned():
            made = create_progress_artifact(0.0, key=key, description=self._text(0, 0))
            self._id = cast(UUID, made)  # not a coroutine: no event loop runs here

    def show(self, done: int, failed: int) -> None:
        """Say how many experiments have ended, and how many of them failed."""
        now = time.monotonic()
        if self._id is None:
            return
        if done == self._total or now - self._shown >= PROGRESS_SECONDS:
            self._shown = now
            share = 100.0 * done / self._total
            with _only_warned():
                update_progress_artifact(self._id, share, description=self._text(done, failed))

    def _text(self, done: int, failed: int) -> str:
        text = f"{self._name}: {done} of {self._total} experiments"
        return f"{text}, {failed} failed" if failed else text


def show_results(name: str, rows: list[Row], report: Path, address: str | None) -> None:
    """Show the tables, the reasons of failures, and where the report is.

    The link leads to ``address``, a page on a server. Without one it leads to the file, which
    browsers open from their own address line only: so its path is told in words too.
    """
    parts = [formats.markdown(table) for table in all_tables(rows)]
    failed = [row for row in rows if row["status"] == "failed"]
    if failed:
        lines = [
            f"- {r['capture']} {r['condition']} seed {r['seed']}: {r['reason']}" for r in failed
        ]
        parts.append("\n".join(["**Failed**", "", *lines]))
    with _only_warned():
        create_markdown_artifact(
            "\n\n".join(parts), key=f"tables-{slug(name)}", description=f"Tables of {name}"
        )
        create_link_artifact(
            address or report.resolve().as_uri(),
            link_text=f"Report of {name}",
            key=f"report-{slug(name)}",
            description=f"{len(rows)} experiments, {len(failed)} failed; {report.resolve()}",
        )


@contextmanager
def _only_warned() -> Iterator[None]:
    try:
        yield
    except Exception as error:  # whatever the server or the way to it raise
        logging.getLogger("mattgs").warning("Prefect's interface was not told: %s", error)


def slug(name: str) -> str:
    """Turn a benchmark's name into letters, digits and dashes, as Prefect wants keys."""
    return "".join(letter if letter.isalnum() else "-" for letter in name.lower()).strip("-")
