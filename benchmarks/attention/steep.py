"""Attention on against off where no ids say what is small: on the steepest pixels of the object.

    python benchmarks/attention/steep.py OUT/benchmarks/attention-others/rows.json --store OUT/store

Of each held-out view the tenth of the object's pixels, without its outline, at which the truth has
the largest Sobel magnitude counts: edges, print, the ends of thin things. Prints a Markdown table
of `attention` − `mask`, paired by view and seed, for these pixels and for all of the object, and
over captures, which are the sample there.
"""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from benchmarks.attention.table import OFF, ON, cell_of, shown, table_of
from mattgs_ops.score.metrics import mask_psnr
from mattgs_ops.splat.attention import Floats, inner, sobel_magnitude
from reports.rows import statistics
from reports.rows.schema import Cell, captures, cells
from reports.tables.pairs import view_scores

SHARE = 0.1  # of the object's pixels; part ids mark 3 to 18 % of the project's own captures
SCORE = "mask_psnr"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--store", type=Path, required=True, help="where the rows' renders lie")
    given = parser.parse_args()
    rows = [row for path in given.rows for row in json.loads(path.read_text(encoding="utf-8"))]
    found = [cell for cell in cells(rows) if cell.finished]
    head = ["capture", "splats", "held-out views", "steepest tenth", "off", "all of the object"]
    lines, means = [head, ["---"] * len(head)], dict[int, list[float]]()
    budgets = sorted({cell.key.budget for cell in found if cell.key.budget is not None})
    for name in sorted(captures(rows)):
        for budget in budgets:
            on, off = (cell_of(found, name, method, budget) for method in (ON, OFF))
            if on is None or off is None:
                continue
            with_it, without = (steep_scores(cell, given.store) for cell in (on, off))
            gap = statistics.paired(with_it, without)
            if gap is not None:
                means.setdefault(budget, []).append(gap.mean)
            whole = statistics.paired(view_scores(on, SCORE), view_scores(off, SCORE))
            level = f"{np.mean(list(without.values())):.2f} dB"
            views = str(len({view for view, _ in with_it}))
            ends = shown(gap, SCORE), level, shown(whole, SCORE)
            lines.append([name, f"{budget:,}", views, *ends])
    for budget, gains in sorted(means.items()):
        over_captures = statistics.sample(gains) if len(gains) > 1 else None
        lines.append(["mean of captures", f"{budget:,}", "", shown(over_captures, SCORE), "", ""])
    print(table_of(lines))


def steep_scores(cell: Cell, store: Path) -> dict[tuple[str, int], float]:
    """Return PSNR in dB on the steepest pixels by test view and seed."""
    scores = {}
    for row in cell.finished:
        folder = store / row["artifacts"]["evaluate"]
        for path in sorted((folder / "truth" / "test").glob("*.png")):
            truth, image = read(path), read(folder / "renders" / "test" / path.name)
            mask = read(folder / "masks" / "test" / path.name)[:, :, 0]
            psnr = mask_psnr(image, truth, steepest(truth, mask))
            if psnr is not None:
                scores[path.name, int(row["seed"])] = psnr
    return scores


def steepest(truth: Floats, mask: Floats) -> np.ndarray:
    """Return which pixels [H, W] of an image [H, W, 3] in [0, 1] count."""
    thing, magnitude = inner(mask), sobel_magnitude(truth)
    steep: np.ndarray = thing & (magnitude >= np.quantile(magnitude[thing], 1 - SHARE))
    return steep


def read(path: Path) -> Floats:
    """Read an image [H, W, 3] in [0, 1]."""
    pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR), dtype=np.float32)
    return pixels / np.float32(255)


if __name__ == "__main__":
    main()
