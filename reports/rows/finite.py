"""Views' scores that are not finite, such as the PSNR of two equal images: JSON holds none."""

import math
from collections.abc import Sequence

from reports.rows.schema import Row, place_of


def without_infinite_views(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """Return the rows without views' scores that are not finite, and a sentence for each of these.

    A report means and prints the others; JSON holds no such number.
    """
    out, sentences = [], []
    for index, row in enumerate(rows):
        views = []
        for view in row["per_view"]:
            wrong = [k for k, v in view.items() if isinstance(v, float) and not math.isfinite(v)]
            sentences += [
                f"row {index} ({place_of(row)}): {name} of {view['view']} is {view[name]}, left out"
                for name in wrong
            ]
            views.append(view | dict.fromkeys(wrong) if wrong else view)
        out.append(row | {"per_view": views})
    return out, sentences
