"""Views' scores that are not finite, such as the PSNR of two equal images: JSON holds none."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from reports.rows.schema import Row, place_of


def infinite_scores(rows: Sequence[Row]) -> list[str]:
    """Return a sentence for each of the views' scores that is not finite."""
    return [
        f"row {index} ({place_of(row)}): {name} of {view['view']} is {view[name]}"
        for index, row in enumerate(rows)
        for view in row.get("per_view") or []  # none of one that failed
        for name in _infinite(view)
    ]


def without_infinite_views(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """Return the rows without views' scores that are not finite, and a sentence for each of these.

    A report means and prints the others; JSON holds no such number.
    """
    out = [
        row | {"per_view": [view | dict.fromkeys(_infinite(view)) for view in row["per_view"]]}
        for row in rows
    ]
    return out, [f"{text}, left out" for text in infinite_scores(rows)]


def _infinite(view: Mapping[str, Any]) -> list[str]:
    """Return the names of a view's scores that are not finite."""
    return [k for k, v in view.items() if isinstance(v, float) and not math.isfinite(v)]
