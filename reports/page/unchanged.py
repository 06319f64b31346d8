"""Whether a report lies there already as it would be built: a repeated run then draws nothing.

:func:`recipe` digests all that a report is made of: rows (which hold the digests of the artifacts
behind them), what else is printed, which artifacts are on this disk, the code with its templates
and the libraries that draw. ``built.json`` beside the report keeps the recipe, and the digest of
each file that came of it: one that is missing, or that somebody changed, is built again.
"""

import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mattgs_ops
import reports
from mattgs_ops.store.digests import file_digest, json_digest
from mattgs_ops.whole_file import write_text_whole
from reports.rows.schema import Row

FILE = "built.json"
SOURCES = {".py", ".j2", ".js", ".css", ".toml"}
LIBRARIES = ("matplotlib", "numpy", "pillow", "opencv-contrib-python-headless", "jinja2")
SHOWN = ("train", "evaluate", "scene")  # what rows call the artifacts that reports look into
PARTS = ("rows.json", "report.md", "report.html", "tables/*", "figures/*")


def recipe(rows: Sequence[Row], root: Path | None, printed: Mapping[str, Any]) -> str:
    """Return the digest of what a report is made of; ``printed`` are JSON values."""
    kinds = [row.get("artifacts") or {} for row in rows]
    names = {of_row[kind] for of_row in kinds for kind in SHOWN if kind in of_row}
    found = sorted(name for name in names if root is not None and (root / name).is_dir())
    parts = {
        "rows": sorted(map(json_digest, rows)),
        "artifacts": found,
        "printed": printed,
        "sources": _sources(),
        "libraries": {name: version(name) for name in LIBRARIES},
    }
    return json_digest(parts)


def holds(folder: Path, made_of: str) -> bool:
    """Whether the folder holds the report of this recipe, each file as it was written."""
    try:
        built = json.loads((folder / FILE).read_text(encoding="utf-8"))
        if built["recipe"] != made_of or not built["files"]:
            return False
        return all(file_digest(folder / name) == was for name, was in built["files"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False


def note(folder: Path, made_of: str) -> None:
    """Note that the folder holds the report of this recipe now."""
    files = sorted(path for part in PARTS for path in folder.glob(part) if path.is_file())
    digests = {path.relative_to(folder).as_posix(): file_digest(path) for path in files}
    text = json.dumps({"recipe": made_of, "files": digests}, indent=1)
    write_text_whole(folder / FILE, text + "\n")


def _sources() -> dict[str, str]:
    """Return the digests of the code that reports come of."""
    roots = [Path(path) for package in (mattgs_ops, reports) for path in package.__path__]
    return {
        f"{root.name}/{path.relative_to(root).as_posix()}": file_digest(path)
        for root in roots
        for path in sorted(root.rglob("*"))
        if path.suffix in SOURCES
    }
