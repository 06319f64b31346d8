"""What attention alone buys: rows of `benchmarks/attention/proof.toml`, attention on against off.

    python benchmarks/attention/table.py OUT/benchmarks/attention-proof/rows.json …
        [--store OUT/store --pictures pictures.png --budget 5000]

The first table is `attention` − `mask`, which differ in nothing but the weight of attention: for
each budget and capture, paired by view and seed, and over captures, whose interval takes captures
for the samples. The second is the same of `attention` − `tuned`, the control without mask and
attention in the loss. The third is Bjøntegaard's rate: how much smaller a file is at equal PSNR.
``--pictures`` shows three small parts a capture as they were rendered: truth, without attention,
with it. They are the largest ones of the first, the middle and the last held-out view, so that
nobody chose them.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from reports.rows import budgets, statistics
from reports.rows.clock import clock_of
from reports.rows.schema import Cell, capture_name, captures, cells
from reports.rows.statistics import Interval
from reports.tables.pairs import ratio, view_scores

ON, OFF, CONTROL = "attention", "mask", "tuned"  # methods of the benchmark
SCORES = {
    "detail_psnr": "small parts",
    "detail_ssim": "SSIM of small parts",
    "detail_flip": "ꟻLIP of small parts",
    "mask_psnr": "whole object",
    "core_psnr": "core",
}
PARTS_SHOWN, SIDE, ZOOM, GAP = 3, 40, 4, 6  # pixels


def main() -> None:
    """Print the tables, and draw the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--store", type=Path, help="where the rows' renders lie")
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--budget", type=int, default=5000)
    given = parser.parse_args()
    rows = [row for path in given.rows for row in json.loads(path.read_text(encoding="utf-8"))]
    found = [cell for cell in cells(rows) if cell.finished]
    for base in (OFF, CONTROL):
        print(differences(found, ON, base, clock_of(rows)))
    print(rates(rows))
    if given.pictures and given.store:
        cv2.imwrite(str(given.pictures), pictures(found, given.store, given.budget))


def cell_of(found: Sequence[Cell], capture: str, method: str, budget: int) -> Cell | None:
    """Return a method's cell, None where it is missing."""
    return next(
        (
            c
            for c in found
            if (c.key.capture, c.key.method, c.key.budget) == (capture, method, budget)
        ),
        None,
    )


def differences(found: Sequence[Cell], method: str, base: str, timer: str) -> str:
    """Compare a method with another at each budget; ``timer`` is the metric of its time."""
    names = captures(row for cell in found for row in cell.finished)
    head = [f"{method} − {base}, splats", "capture", "seeds", *SCORES.values(), "time"]
    lines = [head, ["---"] * len(head)]
    for budget in sorted({cell.key.budget for cell in found}):
        means: dict[str, list[float]] = {score: [] for score in SCORES}
        label = f"{budget:,}"
        for name in names:
            mine, other = (cell_of(found, name, one, budget) for one in (method, base))
            if mine is None or other is None:
                continue
            gaps = {
                score: statistics.paired(view_scores(mine, score), view_scores(other, score))
                for score in SCORES
            }
            for score, gap in gaps.items():
                means[score] += [gap.mean] if gap else []
            seeds = {row["seed"] for row in mine.finished} & {row["seed"] for row in other.finished}
            shares = [shown(gap, score) for score, gap in gaps.items()]
            time = ratio(mine, other, timer)
            cost = "-" if time is None else f"× {time:.2f}"
            lines.append([label, capture_name(name), str(len(seeds)), *shares, cost])
            label = ""
        over_all = [
            shown(statistics.sample(values) if len(values) > 1 else None, score)
            for score, values in means.items()
        ]
        lines.append([label, "mean", "", *over_all, ""])
    return table_of(lines) + "\n"


def table_of(lines: Sequence[Sequence[str]]) -> str:
    """Return cells as a Markdown table."""
    return "\n".join(
        "|" + "|".join(f" {cell} " if cell else " " for cell in line) + "|" for line in lines
    )


def shown(gap: Interval | None, score: str) -> str:
    """Print a mean with half of its interval, bold where the sign is beyond doubt."""
    if gap is None:
        return "-"
    decibels = score.endswith("psnr")
    digits = 2 if decibels else 4
    mean = f"{gap.mean:+.{digits}f}".replace("-", "−")
    text = f"{mean} ± {gap.half:.{digits}f}{' dB' if decibels else ''}"
    return f"**{text}**" if gap.excludes_zero() else text


def rates(rows: Sequence[dict[str, Any]]) -> str:
    """Give Bjøntegaard's rate of the file's size, small parts and whole object."""
    pairs = ((ON, CONTROL), (OFF, CONTROL), (ON, OFF))
    names = captures(rows)
    head = ["size at equal PSNR", "of", *map(capture_name, names), "mean"]
    lines = [head, ["---"] * len(head)]
    for metric, part in (("detail_psnr", "small parts"), ("mask_psnr", "whole object")):
        curves = budgets.curves([r for r in rows if r["status"] == "finished"], "size_mb", metric)
        for method, base in pairs:
            by_capture = {capture: by_method for (capture, _), by_method in curves.items()}
            known = [
                budgets.gap(by_capture[name].get(method, []), by_capture[name].get(base, []))
                for name in names
            ]
            costs = [None if one.cost is None else budgets.percent(one.cost) for one in known]
            texts = ["-" if cost is None else f"{cost:+.0f} %" for cost in costs]
            mean = budgets.mean_cost(known)
            total = (
                "-" if mean is None else f"{mean.mean:+.0f} % ({mean.low:+.0f} to {mean.high:+.0f})"
            )
            signed = [cell.replace("-", "−") if "%" in cell else cell for cell in (*texts, total)]
            lines.append([f"{method} against {base}", part, *signed])
    return table_of(lines)


def pictures(found: Sequence[Cell], store: Path, budget: int) -> NDArray[np.uint8]:
    """Draw truth, off and on side by side: three small parts a capture, a capture a row."""
    sheet = []
    for name in captures(row for cell in found for row in cell.finished):
        both = [cell_of(found, name, method, budget) for method in (OFF, ON)]
        if None in both:
            continue
        folders = [store / cell.finished[0]["artifacts"]["evaluate"] for cell in both if cell]
        views = sorted((folders[0] / "details" / "test").glob("*.png"))
        chosen = [views[0], views[len(views) // 2], views[-1]][:PARTS_SHOWN]
        tiles = []
        for view in chosen:
            x, y = largest_part(view)
            for folder, kind in ((folders[0], "truth"), *((one, "renders") for one in folders)):
                tiles.append(crop(folder / kind / "test" / view.name, x, y))
        sheet.append(np.concatenate(tiles, axis=1))
    return np.concatenate(sheet, axis=0)


def largest_part(path: Path) -> tuple[int, int]:
    """Return the middle of the largest connected small part in an id mask."""
    marked = (np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) > 0).astype(np.uint8)
    _, _, stats, middles = cv2.connectedComponentsWithStats(marked)
    number = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    x, y = middles[number]
    return round(float(x)), round(float(y))


def crop(path: Path, x: int, y: int) -> NDArray[np.uint8]:
    """Cut a square about a pixel, enlarged, with a white edge."""
    image = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR))
    left = int(np.clip(x - SIDE // 2, 0, image.shape[1] - SIDE))
    top = int(np.clip(y - SIDE // 2, 0, image.shape[0] - SIDE))
    part = image[top : top + SIDE, left : left + SIDE]
    large = cv2.resize(part, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_NEAREST)
    edged = cv2.copyMakeBorder(
        large, GAP, GAP, GAP, GAP, cv2.BORDER_CONSTANT, value=(255, 255, 255)
    )
    return np.asarray(edged, dtype=np.uint8)


if __name__ == "__main__":
    main()
