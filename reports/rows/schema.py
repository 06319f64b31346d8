"""Rows: the schema of what one experiment yields, its validator, and how rows form cells.

A **row** is one capture × background × method × seed at one number of iterations and one
resolution, as a JSON object. A **cell** is what a table prints on one line: the same without the
seed. The validator returns a list of problems, and never raises for bad data: whoever prints or
judges decides what a problem means. Nothing here imports more than the standard library.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mattgs_ops.config import BUNDLED
from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row
from mattgs_ops.naming import row_problems as names_and_paths

SCHEMA = 1
PROTOCOL = 2  # raised when the meaning of a number changes: scores across versions do not compare
FIRST_PROTOCOL = 1  # of rows that do not say theirs
Row = dict[str, Any]

# Field: types that it may have. Fields of a failed row may be missing where MAY_LACK says so.
FIELDS: dict[str, tuple[type, ...]] = {
    "schema": (int,),
    "benchmark": (str,),
    "capture": (str,),
    "condition": (str,),
    "background": (str,),
    "method": (str,),
    "seed": (int,),
    "iterations": (int,),
    "resolution": (int,),
    "status": (str,),
    "metrics": (dict,),
    "per_view": (list,),
    "provenance": (dict,),
    "artifacts": (dict,),
}
MAY_LACK = {"metrics", "per_view", "provenance", "artifacts"}
REQUIRED_METRICS = ("ssim", "psnr", "l1", "loss", "fps", "time", "size_mb")
BACKGROUNDS = ("original", "nobg")
NUMBER = (int, float)  # `int | float` would be made anew for each value, which takes longer
METHOD_ORDER = ("3dgs", "3dgs-tuned", "ours", "ours+")

METHOD_NAMES = {"3dgs": "3DGS", "3dgs-tuned": "3DGS tuned", "ours": "Ours", "ours+": "Ours+"}
BACKGROUND_NAMES = {"original": "Original", "nobg": "No BG"}
CAPTURE_NAMES = {"rover": "Rover", "hexapod": "Hexapod", "lattepanda": "LattePanda"}


@dataclass(frozen=True, order=True)
class CellKey:
    """What identifies a line of a table."""

    capture: str
    background: str
    method: str
    iterations: int
    resolution: int
    budget: int = 0  # most splats that it may have, where the benchmark has budgets

    @property
    def condition(self) -> str:
        """Background and method, written ``nobg-ours``."""
        return f"{self.background}-{self.method}"

    def __str__(self) -> str:
        limit = f"x{self.budget}" if self.budget else ""
        return f"{self.capture}/{self.condition}@{self.iterations}x{self.resolution}{limit}"


@dataclass(frozen=True)
class Cell:
    """All seeds of one cell: those that finished, and those that did not."""

    key: CellKey
    finished: tuple[Row, ...]
    failed: tuple[Row, ...]

    @property
    def rows(self) -> tuple[Row, ...]:
        """Finished rows first."""
        return self.finished + self.failed


def read_rows(path: Path) -> list[Row]:
    """Read rows from a JSON file: a list, or an object with a ``rows`` list.

    Raises :class:`InputError` naming the file; for rows whose names or paths would lead out of the
    report's folder, the row and the field too.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # no file, no UTF-8 or no JSON
        raise InputError(f"{path}: expected a readable JSON file of rows: {error}") from error
    rows = data.get("rows") if isinstance(data, dict) else data
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path}: expected a list of rows, found {type(rows).__name__}")
    return [checked_row(row, f"{path}: row {index}") for index, row in enumerate(rows)]


def problems(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return everything that is wrong with the rows, one sentence each; an empty list is good."""
    sentences: list[str] = []
    identities: set[tuple[CellKey, int]] = set()
    for index, row in enumerate(rows):
        own = row_problems(row)
        sentences += [f"row {index} ({place_of(row)}): {text}" for text in own]
        if not own:
            identity = (key_of(row), int(row["seed"]))
            if identity in identities:
                sentences.append(f"row {index} ({place_of(row)}): seed {row['seed']} appears twice")
            identities.add(identity)
    return sentences


def row_problems(row: Mapping[str, Any]) -> list[str]:
    """Return what is wrong with one row."""
    sentences = []
    failed = row.get("status") == "failed"
    for field, types in FIELDS.items():
        if field not in row:
            if not (failed and field in MAY_LACK):
                sentences.append(f"`{field}` is missing")
        elif failed and field in MAY_LACK and row[field] is None:
            continue
        elif not isinstance(row[field], types) or isinstance(row[field], bool):
            expected = " or ".join(t.__name__ for t in types)
            sentences.append(f"`{field}`: expected {expected}, found {row[field]!r}")
    if sentences:
        return sentences
    sentences += _value_problems(row) + names_and_paths(row)
    if not failed:
        sentences += _metric_problems(row["metrics"]) + _view_problems(row["per_view"])
    return sentences


def _value_problems(row: Mapping[str, Any]) -> list[str]:
    sentences = []
    if row["schema"] != SCHEMA:
        sentences.append(f"`schema`: expected {SCHEMA}, found {row['schema']}")
    if row["background"] not in BACKGROUNDS:
        sentences.append(f"`background`: expected original or nobg, found {row['background']!r}")
    expected = f"{row['background']}-{row['method']}"
    if row["condition"] != expected:
        sentences.append(f"`condition`: expected {expected!r}, found {row['condition']!r}")
    if row["status"] not in ("finished", "failed"):
        sentences.append(f"`status`: expected finished or failed, found {row['status']!r}")
    trained_on = row.get("trained_on", [])  # rows of earlier versions have none
    if not isinstance(trained_on, list) or not all(isinstance(one, str) for one in trained_on):
        sentences.append(f"`trained_on`: expected a list of names, found {trained_on!r}")
    if row["status"] == "failed" and not row.get("reason"):
        sentences.append("`reason`: expected the reason of the failure, found none")
    return sentences


def _metric_problems(metrics: Mapping[str, Any]) -> list[str]:
    sentences = [f"`metrics.{name}` is missing" for name in REQUIRED_METRICS if name not in metrics]
    for name, value in metrics.items():
        if value is None and name not in REQUIRED_METRICS:
            continue
        if not isinstance(value, NUMBER) or isinstance(value, bool):
            sentences.append(f"`metrics.{name}`: expected a number, found {value!r}")
        elif not math.isfinite(value):
            sentences.append(f"`metrics.{name}`: expected a finite number, found {value}")
    return sentences


def _view_problems(views: Sequence[Any]) -> list[str]:
    sentences = []
    identities = set()
    for index, view in enumerate(views):
        if not isinstance(view, dict) or "view" not in view or "split" not in view:
            sentences.append(f"`per_view[{index}]`: expected `view` and `split`, found {view!r}")
            continue
        identity = (view["view"], view["split"])
        if identity in identities:
            sentences.append(f"`per_view[{index}]`: {view['view']} ({view['split']}) appears twice")
        identities.add(identity)
    return sentences


def place_of(row: Mapping[str, Any]) -> str:
    """Return a row's place in its grid, as sentences name it."""
    return f"{row.get('capture', '?')}/{row.get('condition', '?')}, seed {row.get('seed', '?')}"


def key_of(row: Mapping[str, Any]) -> CellKey:
    """Return the cell that a row belongs to."""
    return CellKey(
        row["capture"],
        row["background"],
        row["method"],
        int(row["iterations"]),
        int(row["resolution"]),
        int(row.get("budget") or 0),
    )


def refused(rows: Sequence[Row]) -> list[Row]:
    """Turn rows that cannot be used into failed ones that say why, so that no hole is silent.

    Failed rows get the fields that they may lack, empty.

    Rows too broken to say which cell they belong to, and those whose names cannot be names of
    files, raise :class:`InputError`.
    """
    out = []
    for index, row in enumerate(rows):
        checked_row(row, f"row {index}")
        own = row_problems(row)
        if not own:
            nothing: Row = {"metrics": {}, "per_view": []} if row["status"] == "failed" else {}
            out.append(row | {k: v for k, v in nothing.items() if row.get(k) is None})
            continue
        identity = ("capture", "background", "method", "seed", "iterations", "resolution")
        if any(field not in row for field in identity):
            raise InputError(f"row {index}: {'; '.join(own)}")
        reason = row.get("reason") or f"the row is not valid: {'; '.join(own)}"
        out.append(row | {"status": "failed", "reason": reason, "metrics": {}, "per_view": []})
    return out


def cells(rows: Iterable[Row]) -> list[Cell]:
    """Group rows into cells, in the order in which tables print them, seeds ascending."""
    grouped: dict[CellKey, list[Row]] = {}
    for row in rows:
        grouped.setdefault(key_of(row), []).append(row)
    out = []
    for key in sorted(grouped, key=order):
        mine = sorted(grouped[key], key=lambda row: int(row["seed"]))
        good = tuple(row for row in mine if row["status"] == "finished")
        out.append(Cell(key, good, tuple(row for row in mine if row["status"] != "finished")))
    return out


def order(key: CellKey) -> tuple[Any, ...]:
    """Sort key: the bundled captures first and as the paper numbers them, then by name."""
    return (
        _place(key.capture, BUNDLED),
        key.iterations,
        key.resolution,
        _place(key.background, BACKGROUNDS),
        _place(key.method, METHOD_ORDER),
        key.budget,
    )


def _place(name: str, ordered: Sequence[str]) -> tuple[int, str]:
    return (ordered.index(name), "") if name in ordered else (len(ordered), name)


def captures(rows: Iterable[Row]) -> list[str]:
    """Return the captures that appear, in the order of the tables."""
    return sorted({row["capture"] for row in rows}, key=lambda name: _place(name, BUNDLED))


def capture_name(name: str) -> str:
    """How a capture is printed."""
    return CAPTURE_NAMES.get(name, name)


def method_name(name: str) -> str:
    """How a method is printed."""
    return METHOD_NAMES.get(name, name)


def background_name(name: str) -> str:
    """How a background is printed."""
    return BACKGROUND_NAMES.get(name, name)


def condition_name(background: str, method: str) -> str:
    """How a condition is printed, for example ``No BG · Ours``."""
    return f"{background_name(background)} · {method_name(method)}"


def limited(name: str, budget: int) -> str:
    """Add a limit on splats to a printed name: ``3DGS ≤ 5,000``."""
    return f"{name} ≤ {budget:,}" if budget else name


def held_out_views(row: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return a row's per-view scores on the held-out split, sorted by name."""
    views = [view for view in row.get("per_view") or [] if view.get("split") == "test"]
    return sorted(views, key=lambda view: str(view["view"]))
