"""``mattgs compare``: two recorded runs, or two rows of files, side by side."""

import json
import tempfile
from pathlib import Path
from typing import Any

from flows.services import embedded, registries
from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row, slug
from tasks.registry import lookup, summary
from tasks.registry.content import values
from tasks.stages.stage import Cell

STORE = "store"  # in an output folder, beside `benchmarks/NAME/rows.json`
LEVELS = 2  # from a benchmark's folder up to the output folder


def compare(first: str, second: str, out: Path) -> tuple[str, Path]:
    """Compare what the two texts name; return what a terminal shows, and the page's path.

    Each is a run (its id, the beginning of it, its name), a file of rows with one row, or
    ``FILE:NAME`` with a row's name, for example ``rows.json:rover nobg-ours seed 0``. Raises
    :class:`InputError` when one means nothing, or the two do not compare.
    """
    from reports.page import compare as two_runs
    from reports.tables.formats import plain

    with tempfile.TemporaryDirectory(prefix="mattgs-compare-") as folder:
        a, b = _side(first, out, Path(folder) / "a"), _side(second, out, Path(folder) / "b")
        place = out / "comparisons" / slug(f"{a.name} {b.name}")
        tables, headline, page = two_runs.compare(a, b, place)
    return "\n".join([*(plain(table) for table in tables), headline]), page


def _side(text: str, out: Path, folder: Path) -> Any:
    """Return what a text names; files of a server are downloaded into ``folder``."""
    from reports.page.compare import Side

    file, row_name = _file_of(text)
    if file is not None:
        row = _row_of(file, row_name)
        return Side(row, _store_of(file), {})
    embedded.enter_existing(out)
    tracking = registries.current(out)
    found = lookup.find_run(tracking, text)
    files = summary.run_files(tracking, found.run_id, folder / "files")
    row = checked_row(_json(files / "row.json"), f"run {found}: row.json")
    root = summary.fetch(tracking, [row], folder / "root")
    settings = _json(files / "config.json") if (files / "config.json").is_file() else {}
    return Side(row, root, values.flatten(settings))


def _file_of(text: str) -> tuple[Path | None, str]:
    """Split ``FILE:NAME``; no file where the text names none."""
    path, _, name = text.partition(".json:")
    if name:
        return Path(f"{path}.json"), name
    return (Path(text), "") if text.endswith(".json") else (None, "")


def _row_of(file: Path, name: str) -> dict[str, Any]:
    from reports.rows.schema import read_rows

    rows = read_rows(file)
    named = {str(Cell.of(row)): row for row in rows}
    if not name and len(rows) == 1:
        return rows[0]
    if name not in named:
        raise InputError(
            f"{file}: expected FILE:NAME with one of {', '.join(sorted(named)) or 'no rows'}, "
            f"found {name!r}"
        )
    return named[name]


def _store_of(file: Path) -> Path | None:
    """Return the store beside a file of rows that still lies in its output folder."""
    parents = file.resolve().parents
    store = parents[LEVELS] / STORE if len(parents) > LEVELS else None
    return store if store is not None and store.is_dir() else None


def _json(path: Path) -> dict[str, Any]:
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected a JSON file of a run: {error}") from error
    return data
